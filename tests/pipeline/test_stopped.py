"""An object that is stopped by a limit, or whose process dies, keeps what was made of it and says why; the same run can go on from there."""

import json
import os
import subprocess
import sys
import threading
import time

import jsonschema
import numpy as np
import psutil
import pytest

from scan2fea.io import read_mesh
from scan2fea.pipeline import children
from scan2fea.pipeline.config import load_config
from scan2fea.pipeline.run import run
from scan2fea.report.schema import report_schema

SETTINGS = {
    "remeshing.max_faces": 400, "cad.true_faces": False, "cad.patches": False, "tetmeshing.optimise": "none", "run.jobs": 1, "input.unit": "m",
}  # fmt: skip


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    n = 1500
    k = np.arange(n) + 0.5
    polar, around = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    unit = np.c_[np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)]
    path = tmp_path_factory.mktemp("scan") / "ball.xyz"
    np.savetxt(path, unit * (0.1 + 0.0003 * np.random.default_rng(2).standard_normal(n))[:, None], fmt="%.6f")
    return path


def converted(scan, out, *, resume=False, say=None, **settings):
    report = run([scan], out, load_config(None, SETTINGS | settings), resume=resume, say=say)
    jsonschema.validate(json.loads((out / "report.json").read_text()), report_schema())
    row = report["objects"][0]
    assert row["files"] == sorted(path.name for path in (out / "objects" / "01").iterdir())
    return report, row


def worker_of_object():
    waiting = next(child for child in psutil.Process().children() if "scan2fea.pipeline.worker" in child.cmdline())
    return waiting.children()[0]  # its fork


def killer_at(stage):
    """A listener that kills the object's process when it begins `stage`; in tets, once the mesher runs in a process of its own."""
    grandchildren = []

    def kill():
        worker = worker_of_object()
        until = time.monotonic() + 30
        while stage == "tets" and not worker.children() and time.monotonic() < until:
            time.sleep(0.002)
        grandchildren.extend(worker.children())
        worker.kill()

    def say(event):
        if event["event"] == "begin" and event["name"] == stage:
            threading.Thread(target=kill).start()

    say.grandchildren = grandchildren
    return say


SURFACE = ["cloud.ply", "sheet.ply", "surface.ply", "surface.stl"]
VOLUME = ["cloud.ply", "model.bdf", "model.inp", "model.step", "surface.ply", "surface.stl", "volume.msh", "volume.vtu"]


def test_killed_again_and_again_it_keeps_what_was_made_and_goes_on(scan, tmp_path):
    out = tmp_path / "OUT"
    steps = []
    for stage, files in (("remesh", SURFACE), ("tets", sorted([*SURFACE, "model.step"])), ("solve", VOLUME)):
        listener = killer_at(stage)
        report, row = converted(scan, out, resume=bool(steps), say=listener)
        assert row["verdict"] == "failed"
        assert f"killed in its stage '{stage}'" in row["reason"]
        assert row["files"] == files
        assert row["surface"]["closed"] and row["checks"] and all(check["passed"] for check in row["checks"])
        assert len(read_mesh(out / "objects" / "01" / "surface.ply").faces) == row["surface"]["n_faces"]
        assert all(not process.is_running() or process.status() == psutil.STATUS_ZOMBIE for process in listener.grandchildren)
        assert (stage == "tets") == bool(listener.grandchildren)
        steps.append([entry["step"] for entry in row["drift"]])
        assert stage not in [s["name"] for s in report["stages"]]
    assert steps == [["reconstruct", "repair"], ["reconstruct", "repair", "remesh"], ["reconstruct", "repair", "remesh", "tets"]]
    made_again = []
    _, row = converted(scan, out, resume=True, say=lambda e: made_again.append(e["name"]) if e["event"] == "end" and not e["kept"] else None)
    assert row["verdict"] == "converted"
    assert [name for name in made_again if name not in ("read", "place", "clean", "segment")] == ["model", "solve"]


def test_times_of_a_stopped_object_are_those_of_its_work(scan, tmp_path):
    told = {}
    killer = killer_at("remesh")

    def say(event):
        killer(event)
        if event["event"] == "end":
            told[event["name"]] = event["seconds"]

    report, _ = converted(scan, tmp_path / "OUT", say=say)
    assert {s["name"]: s["seconds"] for s in report["stages"]} == told
    assert {"reconstruct", "repair"} <= told.keys()


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [("run.object_seconds", 1.0, "stopped after 1 s of processor time"), ("run.object_gib", 0.1, "more than 0.1 GiB")],
)
def test_limit_is_named_with_its_key_and_stage(key, value, words, scan, tmp_path):
    dense = tmp_path / "dense.xyz"  # too much for a second
    points = np.loadtxt(scan)
    np.savetxt(dense, np.concatenate([points * (1 + 1e-3 * k) @ turn(k) for k in range(4)]), fmt="%.6f")
    _, row = converted(dense, tmp_path / "OUT", **{key: value})
    assert row["verdict"] == "failed"
    assert words in row["reason"] and key in row["reason"] and "stage" in row["reason"]
    assert row["files"][0] == "cloud.ply"
    assert row["n_points"] == 6_000


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def test_cloud_is_kept_where_nothing_else_can_be_written(scan, tmp_path, monkeypatch):
    monkeypatch.setattr(children, "AFTER_SECONDS", 0.0)
    out = tmp_path / "OUT"
    _, row = converted(scan, out, say=killer_at("remesh"))
    assert row["files"] == ["cloud.ply"]
    assert "killed in its stage 'remesh'" in row["reason"]
    assert json.loads((out / ".scan2fea" / "objects" / "01" / "result.json").read_text())["lacks"]  # --resume tries again


def test_fault_of_a_worker_is_told_with_its_last_line(tmp_path):
    (tmp_path / "01").mkdir()
    (tmp_path / "01" / "task.json").write_text("{}")
    told = []
    with children.Workers(1) as workers:
        workers.begin()
        limits = children.Limits(seconds=60, gib=4)
        children.run_children([tmp_path / "01"], workers, limits, lambda _: None, lambda folder, why: told.append((folder.name, why)))
    ((name, why),) = told
    assert name == "01"
    assert why.startswith("its process died before its first stage (code 1: KeyError")


def test_half_a_line_of_a_killed_child_is_not_read():
    seen = []
    heard = children._Heard(seen.append)
    for line in ('{"event": "begin", "name": "a"}\n', "a library says hello\n", '{"event": "end", "na\n', '{"event": "left", "code": -9}\n'):
        heard.line(line)
    assert heard.code == -9
    assert [event["event"] for event in seen] == ["begin"]
    assert heard.stage == "a" and heard.stages == []


def test_interrupt_stops_what_runs_and_begins_nothing(scan, tmp_path):
    begun = []

    def say(event):
        begun.append(event)
        if event["event"] == "begin" and event["name"] == "reconstruct":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run([scan], tmp_path / "OUT", load_config(None, SETTINGS), say=say)
    assert [child for child in psutil.Process().children(recursive=True) if "scan2fea.pipeline.worker" in child.cmdline()] == []
    assert "verdict" not in [event["event"] for event in begun]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGTERM that a program could catch")
def test_a_run_that_is_asked_to_end_leaves_no_worker_behind(scan, tmp_path):
    command = [sys.executable, "-m", "scan2fea", "run", str(scan), "--unit", "m", "-o", str(tmp_path / "OUT")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as program:
        until, log = time.monotonic() + 120, tmp_path / "OUT" / "log.jsonl"
        while time.monotonic() < until and not (log.exists() and '"estimate"' in log.read_text()):
            time.sleep(0.05)
        family = psutil.Process(program.pid).children(recursive=True)
        program.terminate()
        assert program.wait(30) == 130
        assert "--resume" in program.stderr.read()
    assert family and not [child for child in family if child.is_running() and child.status() != psutil.STATUS_ZOMBIE]
