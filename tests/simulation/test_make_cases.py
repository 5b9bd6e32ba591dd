"""The held-out cases of benchmarks/make_cases.py are what their truth says."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scan2fea.io import InputOptions, read_mesh, read_scan
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.measures import volume

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "make_cases.py"


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cases")
    command = [sys.executable, str(SCRIPT), str(folder), "--n", "17", "--seed", "5", "--points", "3000"]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def test_points_lie_where_the_truth_says_with_its_noise(cases):
    names = sorted(p.name for p in cases.iterdir())
    assert len(names) == 17
    for name in names:
        truth = json.loads((cases / name / "truth.json").read_text())
        thing = truth["objects"][0]
        mesh = read_mesh(cases / name / thing["mesh"])
        assert volume(mesh) == pytest.approx(thing["volume_m3"], rel=1e-9)
        scans = [read_scan(cases / name / f, InputOptions(unit=truth["unit"])).scan for f in truth["files"]]
        points = np.concatenate([s.cloud.points for s in scans])
        assert len(points) == truth["n_points"]
        off = distance_to_mesh(points, mesh).distance
        size = float(np.abs(points).max())
        assert np.sqrt((off**2).mean()) <= truth["noise_sd_m"] * 1.1 + 2e-7 * size + 1e-6, name  # single precision in PCD
        assert np.sqrt((off**2).mean()) >= truth["noise_sd_m"] * 0.4, name
        if len(scans) > 1:
            assert all(np.isfinite(s.sensors()).all() for s in scans if len(s.cloud))
        assert set(thing["unobservable"]) <= set(thing["params_m"])
        assert truth["expect"] in ("convert", "may_fail")


@pytest.fixture(scope="module")
def hard_cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hard")
    command = [sys.executable, str(SCRIPT), str(folder), "--n", "24", "--seed", "5", "--points", "2000", "--hard"]
    subprocess.run(command, check=True, capture_output=True)
    return folder


def test_hard_cases_show_the_object_that_they_say_among_their_strays(hard_cases):
    ways = set()
    for folder in sorted(hard_cases.iterdir()):
        truth = json.loads((folder / "truth.json").read_text())
        mesh = read_mesh(folder / truth["objects"][0]["mesh"])
        scans = [read_scan(folder / f, InputOptions(unit=truth["unit"])).scan for f in truth["files"]]
        points = np.concatenate([s.cloud.points for s in scans])
        assert len(points) == truth["n_points"]
        off = distance_to_mesh(points, mesh).distance
        on_it = np.mean(off < 6 * truth["noise_sd_m"] + 2e-7 * np.abs(points).max() + 1e-6)
        assert on_it > (0.8 if "strays" in truth["title"] else 0.995), truth["title"]
        assert len(scans) == 1 or all(np.isfinite(s.sensors()).all() for s in scans if len(s.cloud))
        ways |= {way for way in ("cut", "never seen", "not told", "strays", "laplace", "uniform") if way in truth["title"]}
    assert len(ways) == 6


@pytest.mark.parametrize(("made", "how"), [("cases", []), ("hard_cases", ["--hard"])])
def test_same_seed_same_bytes(made, how, request, tmp_path):
    points = "2000" if how else "3000"
    subprocess.run([sys.executable, str(SCRIPT), str(tmp_path), "--n", "2", "--seed", "5", "--points", points, *how], check=True, capture_output=True)
    for path in tmp_path.rglob("*"):
        if path.is_file():
            assert path.read_bytes() == (request.getfixturevalue(made) / path.relative_to(tmp_path)).read_bytes()
