import math
import re

import numpy as np
import pytest

from fea.test_deck import calculix
from scan2fea.errors import SolveError
from scan2fea.fea import FeaOptions
from scan2fea.fea.wireframe import frame_model, frame_result_rows, solve_frame, write_frame_inp
from scan2fea.kernel.transforms import random_rotation

NODES = np.array([[0, 0, 0], [0, 0, 2.0], [2.0, 0, 2.0], [2.0, 0, 0]])
ELEMENTS = np.array([[0, 1], [1, 2], [2, 3]])
UP = np.array([[0, 1.0, 0]] * 3)
BAR = ("rect", {"b": 0.05, "t": 0.03})
ANGLE = ("L", {"a": 0.1, "b": 0.1, "t": 0.01})


def portal(section=BAR, **options):
    return frame_model(NODES, ELEMENTS, np.arange(3), UP, [section], np.zeros(3, np.int64), FeaOptions(**options))


def test_a_portal_stands_and_balances():
    model = portal()
    result = solve_frame(model)
    rows = frame_result_rows(model, result)
    assert model.held.tolist() == [0, 3] and rows["n_pieces"] == 1 and rows["n_members"] == 3
    assert rows["weight_n"] == pytest.approx(7850 * 9.80665 * 6 * 0.0015, rel=1e-4)  # the held nodes' own share too
    assert rows["unbalanced"] < 1e-6
    # the beam sags between its ends held and its ends free to turn
    q, length, ei = 7850 * 9.80665 * 0.0015, 2.0, 210e9 * 0.05**3 * 0.03 / 12
    assert q * length**4 / (384 * ei) < rows["displacement_max_m"] < 5 * q * length**4 / (384 * ei)


SMALL = [("rect", {"b": 0.02, "t": 0.012}), ("CHS", {"d": 0.03, "t": 0.003}), ("RHS", {"h": 0.02, "b": 0.03, "t": 0.002}), ("round", {"d": 0.02})]


@pytest.mark.parametrize("section", SMALL)
def test_calculix_finds_the_same(section, tmp_path):
    """Its beams are solids of 20 nodes inside, rigid where they overlap at joints: a few per cent."""
    model = portal(section)
    steps, _ = calculix(write_frame_inp(model), tmp_path)
    ours = np.linalg.norm(solve_frame(model).displacement_m[:, :3], axis=1).max()
    # a circle is eight nodes of second order to it
    assert np.linalg.norm(steps[0], axis=1).max() == pytest.approx(ours, rel=0.08 if section[0] == "round" else 0.05)


@pytest.mark.parametrize("section", [SMALL[0], SMALL[2]])
def test_calculix_finds_the_same_however_a_cantilever_leans(section, tmp_path):
    hertz = []
    for k, turn in enumerate([np.eye(3), random_rotation(np.random.default_rng(4)), random_rotation(np.random.default_rng(5))]):
        nodes = np.array([[0, 0, 0], [0, 0, 0.6]]) @ turn.T
        model = frame_model(nodes, np.array([[0, 1]]), np.zeros(1, np.int64), turn[None, :, 1], [section], np.zeros(1, np.int64), FeaOptions())
        folder = tmp_path / str(k)
        folder.mkdir()
        _, told = calculix(write_frame_inp(model), folder)
        hertz.append([float(h) for h in re.findall(r"^ +[123] +\S+ +\S+ +(\S+) +\S+$", told, re.M)][:2])
        assert hertz[-1] == pytest.approx(solve_frame(model).frequencies_hz[:2].tolist(), rel=0.04)
    assert hertz[1] == pytest.approx(hertz[0], rel=1e-4) and hertz[2] == pytest.approx(hertz[0], rel=1e-4)


def test_open_sections_are_for_abaqus_and_say_so():
    text = write_frame_inp(portal(ANGLE))
    assert "solved embedded" in text and "*BEAM GENERAL SECTION, SECTION=GENERAL, ELSET=MEMBER_01" in text
    assert solve_frame(portal(ANGLE)).frequencies_hz[0] > 1
    assert write_frame_inp(portal(ANGLE)) == text


def test_pieces_stand_each_by_itself():
    nodes = np.concatenate([NODES, NODES + [0, 5.0, 0.5]])
    elements = np.concatenate([ELEMENTS, ELEMENTS + 4])
    model = frame_model(nodes, elements, np.arange(6), np.tile([0, 1.0, 0], (6, 1)), [BAR], np.zeros(6, np.int64), FeaOptions())
    assert model.n_pieces == 2 and model.held.tolist() == [0, 3, 4, 7]
    one = solve_frame(portal()).frequencies_hz
    assert solve_frame(model).frequencies_hz[:2] == pytest.approx([one[0]] * 2)


def test_a_cantilever_along_any_axis():
    for k in range(3):
        up = np.roll([0.0, 1.0, 0.0], k)[None]
        model = frame_model(np.array([np.zeros(3), 2.0 * np.eye(3)[k]]), np.array([[0, 1]]), np.zeros(1, np.int64), up, [BAR], np.zeros(1, np.int64),
                            FeaOptions(down="-" + "xyz"[k]))  # fmt: skip
        u = solve_frame(model).displacement_m[:, k].min()
        assert u == pytest.approx(-7850 * 9.80665 * 4 / (2 * 210e9), rel=0.05)  # standing: rho g L^2 / 2 E
    assert math.isfinite(u)


def test_messages():
    with pytest.raises(SolveError, match="no members"):
        frame_model(NODES, np.zeros((0, 2), np.int64), np.zeros(0, np.int64), UP, [BAR], np.zeros(3, np.int64), FeaOptions())
    with pytest.raises(SolveError, match="no length"):
        frame_model(NODES, np.array([[0, 0]]), np.zeros(1, np.int64), UP, [BAR], np.zeros(3, np.int64), FeaOptions())


def test_elements_are_short_beside_joints():
    nodes, up = np.array([[0.0, 0, 0], [3.0, 0, 0]]), np.array([[0.0, 0.0, 1.0]])
    model = frame_model(nodes, np.array([[0, 1]]), np.array([0]), up, [("CHS", {"d": 0.1, "t": 0.005})], np.array([0]), FeaOptions())
    ends = model.beams.nodes[model.beams.elements]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert length.sum() == pytest.approx(3.0)
    np.testing.assert_allclose(length, length[::-1])
    assert length[0] < 0.05 * 3.0 and length.max() < 0.2 * 3.0
