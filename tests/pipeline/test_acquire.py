"""Inputs without points on their way into the chain."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from PIL import Image

from scan2fea.acquisition import AcquisitionOptions
from scan2fea.cli.main import main
from scan2fea.pipeline.acquire import NO_SCALE, grouped, without_scale


def _picture(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(path)
    return path


def test_inputs_are_read_together_by_what_they_are(tmp_path: Path) -> None:
    a, b = _picture(tmp_path / "a.png"), _picture(tmp_path / "b.jpg")
    photographs, inner, depths = tmp_path / "photos", tmp_path / "set", tmp_path / "rgbd"
    own = [_picture(photographs / f"{k}.png") for k in range(2)]
    deep = [_picture(inner / "images" / "1.png")]
    _picture(depths / "depth" / "0.png")
    scan, log = tmp_path / "scan.ply", tmp_path / "log.csv"
    plain = [(g.kind, g.paths) for g in grouped([scan, a, photographs, b, inner, depths], AcquisitionOptions())]
    assert plain == [
        ("scan", (scan,)), ("photographs", (a, b)), ("photographs", tuple(own)), ("photographs", tuple(deep)), ("rgbd", (depths,))
    ]  # fmt: skip
    assert [g.kind for g in grouped([a, b], AcquisitionOptions(calibration="rig.yml"))] == ["stereo"]
    assert [g.kind for g in grouped([log], AcquisitionOptions(sensor="ultrasonic"))] == ["ultrasonic"]
    assert [g.kind for g in grouped([log], AcquisitionOptions())] == ["scan"]


def test_what_has_no_scale_is_not_put_beside_what_has(tmp_path: Path) -> None:
    def inputs(*sources: str) -> tuple[list[object], list[dict[str, object]]]:
        raws = [SimpleNamespace(value=SimpleNamespace(path=f"{k}.png", unit_source=s)) for k, s in enumerate(sources)]
        return list(raws), [{"path": f"{k}.png", "used": True, "unit_source": s, "reason": None} for k, s in enumerate(sources)]

    raws, rows = inputs(NO_SCALE, "format")
    without_scale(raws, rows)
    assert [raw.value.path for raw in raws] == ["1.png"]
    assert [row["used"] for row in rows] == [False, True] and "--scale" in str(rows[0]["reason"])
    raws, rows = inputs(NO_SCALE, NO_SCALE)
    without_scale(raws, rows)
    assert len(raws) == 2 and all(row["used"] for row in rows)


def test_a_log_of_pings_is_registered(tmp_path: Path) -> None:
    k = np.linspace(0.0, 1.0, 60)
    rows = [f"{x},{y},0.3,1,{d},0,{1.0 - x}" for x, y, d in zip(0.1 * np.sin(9 * k), k, 0.1 * np.cos(5 * k), strict=True)]
    (tmp_path / "log.csv").write_text("x,y,z,dx,dy,dz,range_m\n" + "\n".join(rows) + "\n")
    assert main(["register", str(tmp_path / "log.csv"), "--sensor", "ultrasonic", "-o", str(tmp_path / "out")]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["inputs"][0]["used"] and report["inputs"][0]["n_points"] == 60
    assert report["acquisition"][0]["method"] == "ultrasonic" and report["acquisition"][0]["n_echoes"] == 60


def test_an_unknown_sensor_and_a_lone_photograph_are_refused(tmp_path: Path, capsys: object) -> None:
    picture = _picture(tmp_path / "a.png")
    assert main(["run", str(picture), "-o", str(tmp_path / "out")]) == 3
    assert "one photograph alone" in capsys.readouterr().err  # type: ignore[attr-defined]
    assert main(["run", str(picture), "--sensor", "sonar", "-o", str(tmp_path / "out")]) == 2
    assert "ultrasonic" in capsys.readouterr().err  # type: ignore[attr-defined]
