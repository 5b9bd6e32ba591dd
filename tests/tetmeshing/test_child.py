"""The child process: what it says when gmsh refuses, crashes or is stopped."""

import sys

import numpy as np
import pytest

from predicates import sphere
from scan2fea.errors import MeshingError
from scan2fea.tetmeshing.child import in_words, run_worker

LIMITS = {"time_limit_s": 60.0, "memory_limit_gib": 4.0}


def job(**changes):
    ball = sphere(rounds=1)
    return {"kind": "surface", "vertices": ball.vertices, "faces": ball.faces, "growth": 0.4, "algorithm": "delaunay", "good_deg": 0.0, **changes}


def test_tets_of_a_ball():
    found = run_worker(job(), **LIMITS)
    assert found["tets"].shape[1] == 4
    assert str(found["done"]) == "delaunay"


def test_known_reasons_in_words():
    assert in_words("Invalid boundary mesh (overlapping facets) on surface 1 surface 1").startswith(
        "two parts of the surface lie on one another: repair"
    )
    assert "the surface crosses itself or folds back" in in_words("PLC Error:  A segment and a facet intersect at point")
    assert "raise tetmeshing.memory_limit_gib" in in_words("Unable to allocate 80.2 MiB for an array with shape (876325, 4, 3)")
    assert in_words("something new") == "gmsh could not fill the surface: something new"


def test_an_error_in_the_child_arrives_as_one():
    with pytest.raises(MeshingError, match="gmsh could not fill the surface"):
        run_worker(job(faces=sphere(rounds=1).faces + 5), **LIMITS)  # beyond the vertices


def test_a_crash_is_told_as_one(tmp_path, monkeypatch):
    child = sys.modules["scan2fea.tetmeshing.child"]
    crash = tmp_path / "worker.py"
    crash.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    monkeypatch.setattr(child, "__file__", str(tmp_path / "child.py"))
    with pytest.raises(MeshingError, match=r"the mesher crashed \(signal 11"):
        run_worker(job(), **LIMITS)
    crash.write_text("raise MemoryError\n")
    with pytest.raises(MeshingError, match="ran out of its 4 GiB"):
        run_worker(job(), **LIMITS)
    crash.write_text("import time\ntime.sleep(30)\n")
    with pytest.raises(MeshingError, match="stopped after 1 s of processor time"):
        run_worker(job(), time_limit_s=1.0, memory_limit_gib=4.0)


def test_needles_are_not_given_to_hxt_in_a_second_attempt():
    ball = sphere(rounds=1)
    with pytest.raises(MeshingError, match="needles"):
        run_worker(job(vertices=ball.vertices * [1, 1, 0.05], algorithm="other"), **LIMITS)


def test_arguments_are_not_changed():
    given = job()
    before = given["vertices"].copy()
    run_worker(given, **LIMITS)
    assert "memory_gib" not in given
    assert np.array_equal(before, given["vertices"])
