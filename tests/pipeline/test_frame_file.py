"""frame.json."""

import json
from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from scan2fea.errors import StageError
from scan2fea.fea import FeaOptions
from scan2fea.pipeline.frame_file import frame_of, write_frame
from scan2fea.pipeline.results import assumed
from scan2fea.types import Damage, SectionChange


def test_members_are_written_by_name(tmp_path):
    assert not write_frame(tmp_path, [], [])
    assert not list(tmp_path.iterdir())
    assert write_frame(tmp_path, [made("L", 2.0), made("CHS", 1.0, shift=(5, 0, 0))], ["OBJECT_01", "OBJECT_02"])
    rows = json.loads((tmp_path / "frame.json").read_text(encoding="utf-8"))
    assert [m["name"] for m in rows["members"]] == ["OBJECT_01", "OBJECT_02"]
    assert len(rows["nodes"]) == 4 and [s["family"] for s in rows["sections"]] == ["L", "CHS"]


def test_a_section_that_changes_is_told_and_no_beam_of_one_section(tmp_path):
    """A tapered pole, right to 0.01 % of its volume, had been refused for deflecting otherwise than a beam of its least section."""
    change = SectionChange(kind="taper", dimension="d", z_m=np.array([0.0, 3.0]), value_m=np.array([0.1, 0.2]), std_m=np.zeros(2))
    pole = replace(made("CHS", 3.0), change=change)
    assert write_frame(tmp_path, [made("L", 2.0), pole], ["OBJECT_01", "OBJECT_02"])
    first, second = json.loads((tmp_path / "frame.json").read_text(encoding="utf-8"))["members"]
    assert "change" not in first and second["change"]["value_m"] == [0.1, 0.2]
    with pytest.raises(StageError, match="section changes"):
        frame_of([pole], FeaOptions())
    assert "d changes along it, 100 to 200 mm" in assumed(pole) and "changes" not in assumed(made("CHS", 3.0))


def test_damage_is_told_of_a_solid_that_is_whole_there():
    """A beam with a corner spalled by 29 mm came as a whole one, and only a list in the report said so."""
    loss, dent = (
        Damage(kind=kind, position_m=np.zeros(3), size_m=0.06, depth_m=depth, std_m=0.002, p_value=1e-9)
        for kind, depth in (("loss", 0.029), ("dent", 0.01))
    )
    assert "at one place the points leave it, by up to 29 mm (loss): the solid is whole there" in assumed(replace(made("rect"), damage=(loss,)))
    assert "at 2 places the points leave it, by up to 29 mm (loss)" in assumed(replace(made("rect"), damage=(dent, loss)))
    assert "leave it" not in assumed(made("rect"))
