"""frame.json."""

import json

from estimation.made import made
from scan2fea.pipeline.frame_file import write_frame


def test_members_are_written_by_name(tmp_path):
    assert not write_frame(tmp_path, [], [])
    assert not list(tmp_path.iterdir())
    assert write_frame(tmp_path, [made("L", 2.0), made("CHS", 1.0, shift=(5, 0, 0))], ["OBJECT_01", "OBJECT_02"])
    rows = json.loads((tmp_path / "frame.json").read_text(encoding="utf-8"))
    assert [m["name"] for m in rows["members"]] == ["OBJECT_01", "OBJECT_02"]
    assert len(rows["nodes"]) == 4 and [s["family"] for s in rows["sections"]] == ["L", "CHS"]
