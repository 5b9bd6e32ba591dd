"""Wireframes: where members meet there is one node, where they do not there are two."""

import json
from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from predicates import rotation
from scan2fea.estimation.frame import frame, frame_rows


def between(start, end, family="RHS", values=None, R=np.eye(3), shift=(0, 0, 0)):
    """A member whose centroid axis runs from start to end."""
    p, q = (R @ np.asarray(x, float) + shift for x in (start, end))
    z = (q - p) / np.linalg.norm(q - p)
    x = np.cross(R @ [0.3, 0.5, 0.8], z)
    x /= np.linalg.norm(x)
    return made(family, float(np.linalg.norm(q - p)), values, R=np.stack([x, np.cross(z, x), z], axis=1), shift=p)


def portal(**where):
    """Two columns, a girder that stops at their faces, a brace from a column into the girder, and a post that stands alone."""
    ends = (
        ([0, 0, 0], [0, 0, 3]),
        ([4, 0, 0], [4, 0, 3]),
        ([0.03, 0, 3.02], [3.95, 0.01, 3.0]),
        ([0.05, 0, 1.5], [2, 0, 2.95]),
        ([2, 2, 0], [2, 2, 3]),
    )
    return [between(*pair, **where) for pair in ends]


def test_portal():
    found = frame(portal())
    assert len(found.nodes) == 8
    assert found.member.tolist() == [0, 0, 1, 2, 2, 3, 4]
    degree = np.bincount(found.elements.ravel())
    assert sorted(degree) == [1, 1, 1, 1, 2, 2, 3, 3]
    corner = found.nodes[np.linalg.norm(found.nodes - [0, 0, 3], axis=1).argmin()]
    assert np.linalg.norm(corner - [0, 0, 3.02]) < 0.005  # where the axes meet, not where the girder stops
    assert found.offset_m.max() < 0.006
    assert found.sections.tolist() == [0] * 5 and found.section_rows[0]["family"] == "RHS"


def test_rigid_motion_and_json():
    R, shift = rotation(3), np.array([100.0, -50.0, 7.0])
    one, other = frame(portal()), frame(portal(R=R, shift=shift))
    assert other.nodes == pytest.approx(one.nodes @ R.T + shift, abs=1e-9)
    assert np.array_equal(one.elements, other.elements)
    rows = json.loads(json.dumps(frame_rows(other, [f"OBJECT_{k:02d}" for k in range(5)]), allow_nan=False))
    assert rows["members"][0]["name"] == "OBJECT_00" and len(rows["nodes"]) == 8 and rows["unit"] == "m"
    assert [len(m["elements"]) for m in rows["members"]] == [2, 1, 2, 1, 1]
    assert rows["sections"][0]["parameters_m"]["h"] == 0.1


def test_the_reach_is_both_sections():
    """RHS 100 x 60: its corners lie 58.3 mm from its axis; two of them reach 116.6 mm (and 3 sd of the lengths)."""
    reach = 2 * np.hypot(0.05, 0.03) + 3 * np.sqrt(2) * 1e-4
    for gap, n_elements in ((reach - 1e-4, 3), (reach + 1e-4, 2)):
        found = frame([between([0, 0, 0], [0, 0, 2]), between([gap, 0, 1], [1, 0, 1])])
        assert len(found.elements) == n_elements


def test_an_arm_beyond_a_joint_stays_however_uncertain_the_others_length_is():
    """How far the stem of a tee reaches says nothing of the place along the other member at which it does."""
    stem = between([0.15, 0, 0.05], [0.15, 0, 0.5])
    vague = replace(stem, parameters=(*stem.parameters[:-1], replace(stem.parameters[-1], std_m=0.02)))
    assert len(frame([between([0, 0, 0], [0.6, 0, 0]), vague]).elements) == 3


def test_crossing_members_are_joined_parallel_ones_are_not():
    crossed = frame([between([-1, 0, 0], [1, 0, 0]), between([0, -1, 0.05], [0, 1, 0.05])])
    assert len(crossed.nodes) == 5 and len(crossed.elements) == 4
    assert len(frame([between([0, 0, 0], [0, 0, 2]), between([0.06, 0, 0.5], [0.06, 0, 1.5])]).nodes) == 4
    splice = frame([between([0, 0, 0], [0, 0, 2]), between([0, 0.01, 2.05], [0, 0.01, 4])])
    assert len(splice.nodes) == 3 and len(splice.elements) == 2


def test_sections_that_differ_beyond_their_errors_are_two():
    odd = between([1, 0, 0], [1, 0, 2], values={"h": 0.101, "b": 0.06, "t": 0.005})
    same = between([2, 0, 0], [2, 0, 2], values={"h": 0.1002, "b": 0.06, "t": 0.005})
    found = frame([between([0, 0, 0], [0, 0, 2]), odd, same])
    assert found.sections.tolist() == [0, 1, 0]
    assert found.section_rows[0]["area_m2"] == pytest.approx(0.0015)
    assert frame([]).nodes.shape == (0, 3)
