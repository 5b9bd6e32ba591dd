"""Defects keep a solid closed, and take from it what their formula says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing
from scan2fea.errors import InputError
from scan2fea.kernel.construction import bent
from scan2fea.kernel.measures import volume
from scan2fea.simulation import defects
from scan2fea.simulation.carving import carved, sliced
from scan2fea.simulation.shape_kinds import KINDS

BOX = KINDS["box"].build({"x": 0.4, "y": 0.3, "z": 0.2}, 1e-4).mesh
I = KINDS["I"].build({"h": 0.2, "b": 0.1, "tw": 0.006, "tf": 0.009, "length": 1.5}, 1e-4).mesh  # noqa: E741
RHS = KINDS["RHS"].build({"h": 0.14, "b": 0.08, "t": 0.006, "length": 1.6}, 1e-4).mesh
CHS = KINDS["CHS"].build({"d": 0.1, "t": 0.005, "length": 0.8}, 1e-4).mesh


def assert_sound(mesh):
    assert_closed_manifold_oriented(mesh)
    assert_no_crossing(mesh)


@pytest.mark.parametrize(
    ("mesh", "make", "lost"),
    [
        (BOX, lambda m: defects.without_corner(m, "+-+", 0.05), 0.05**3 / 6),
        (BOX, lambda m: defects.slotted(m, 0.1, 0.01, 0.05, "+x"), 0.05 * 0.01 * 0.3),
        (I, lambda m: defects.slotted(m, 0.7, 0.01, 0.05, "+y"), 0.01 * (0.1 * 0.009 + 0.041 * 0.006)),
        (I, lambda m: defects.slotted(m, 0.7, 0.01, 0.05, "-x"), 0.01 * (2 * 0.05 * 0.009 + 0.003 * 0.182)),
        (RHS, lambda m: defects.slotted(m, 0.7, 0.01, 0.05, "-y"), 0.01 * (0.08 * 0.006 + 2 * 0.006 * 0.044)),
        (CHS, lambda m: defects.slotted(m, 0.4, 0.01, 0.05, "+y"), volume(CHS) * 0.01 / 0.8 / 2),
    ],
)
def test_what_is_cut_away(mesh, make, lost):
    before = mesh.vertices.copy(), mesh.faces.copy()
    damaged = make(mesh)
    assert_sound(damaged)
    assert volume(mesh) - volume(damaged) == pytest.approx(lost, rel=1e-10)
    assert np.array_equal(before[0], mesh.vertices) and np.array_equal(before[1], mesh.faces)


@pytest.mark.parametrize("corner", ["+++", "---", "+-+", "-++"])
@pytest.mark.parametrize("mesh", [BOX, I, RHS, CHS], ids=["box", "I", "RHS", "CHS"])
def test_a_corner_and_what_is_left_make_the_whole(mesh, corner):
    sign = np.array([1.0 if c == "+" else -1.0 for c in corner])
    at = np.where(sign > 0, mesh.vertices.max(0), mesh.vertices.min(0))
    rest, piece = carved(mesh, [(sign, float(sign @ at - 0.06))]), carved(mesh, [(-sign, -float(sign @ at - 0.06))])
    for part in (rest, piece):
        assert volume(part) > 0
    assert_sound(rest)
    assert volume(rest) + volume(piece) == pytest.approx(volume(mesh), rel=1e-12)


def test_sag_keeps_the_volume_and_reaches_its_depth():
    bent = defects.sagged(I, 0.02, "-y", 1e-5)
    assert_sound(bent)
    assert volume(bent) == pytest.approx(volume(I), rel=1e-12)
    middle = np.abs(bent.vertices[:, 2] - 0.75) < 0.76 / 45
    assert bent.vertices[:, 1].min() == pytest.approx(-0.12, abs=1e-5)
    assert np.ptp(bent.vertices[middle][:, 1]) == pytest.approx(0.2, abs=2e-5)
    ends = (bent.vertices[:, 2] == 0) | (bent.vertices[:, 2] == 1.5)
    assert bent.vertices[ends][:, 1].min() == -0.1


def test_twist_turns_the_end_and_nearly_keeps_the_volume():
    turned = defects.twisted(RHS, 0.1, 1e-4)
    assert_sound(turned)
    assert volume(turned) == pytest.approx(volume(RHS), rel=1e-3)
    end = turned.vertices[turned.vertices[:, 2] == turned.vertices[:, 2].max()]
    own = RHS.vertices[RHS.vertices[:, 2] == RHS.vertices[:, 2].max()]
    expected = own[:, :2] @ np.array([[math.cos(0.1), math.sin(0.1)], [-math.sin(0.1), math.cos(0.1)]])
    for corner in expected:
        assert np.linalg.norm(end[:, :2] - corner, axis=1).min() < 1e-12


def test_a_dent_in_a_flat_face_takes_its_formula_and_through_a_wall_nothing():
    expected = math.pi * 0.06**2 * 0.01 / 3
    errors = []
    for chord in (2e-4, 5e-5):
        dented = defects.dented(BOX, np.array([0.2, 0.15, 0.2]), "-z", 0.06, 0.01, 0.02, chord)
        assert_sound(dented)
        errors.append(abs(volume(BOX) - volume(dented) - expected) / expected)
        assert dented.vertices[:, 2].min() == 0
    assert errors[1] < errors[0] < 0.01
    wall = defects.dented(RHS, np.array([0.04, 0, 0.8]), "-x", 0.03, 0.004, 0.01, 2e-4)
    assert_sound(wall)
    assert abs(volume(wall) - volume(RHS)) < 1e-3 * math.pi * 0.03**2 * 0.004


def test_a_dent_in_the_middle_of_one_large_triangle_is_made():
    """No edge comes near it: the face itself must be divided."""
    dented = defects.dented(BOX, np.array([0.3, 0.05, 0.2]), "-z", 0.02, 0.005, 0.02, 2e-5)
    assert_sound(dented)
    assert volume(BOX) - volume(dented) == pytest.approx(math.pi * 0.02**2 * 0.005 / 3, rel=0.02)


def test_a_dent_that_would_fold_a_face_is_refused():
    """A side of the box pushed along itself where its reach ends: what gives way would lie over what does not."""
    with pytest.raises(InputError, match="folds a face"):
        defects.dented(BOX, np.array([0.4, 0.3, 0.1]), "-x", 0.05, 0.02, 0.1, 1e-4)


def test_what_is_told_of_a_defect_is_what_it_did():
    """kernel.construction moves the places of the sliced mesh to the places of the damaged one, and its planes part the volume alike."""
    values = {"depth": 0.02, "angle_deg": 8.0, "size": 0.05, "at": 0.1, "width": 0.01}
    words = {"direction": "-y", "corner": "+-+", "side": "+x"}
    for kind in ("sag", "twist"):
        change = defects.DEFECTS[kind].tell(I, values, words, {})
        made = defects.DEFECTS[kind].make(I, values, words, {}, 1e-3)
        z = np.unique(made.vertices[:, 2])
        straight = sliced(I, (0, 0, 1), z[1:-1].tolist())
        assert sorted(map(tuple, np.round(bent(straight.vertices, change), 9))) == sorted(map(tuple, np.round(made.vertices, 9)))
    for kind in ("missing_corner", "cut"):
        change = defects.DEFECTS[kind].tell(BOX, values, words, {})
        again = carved(BOX, list(zip(change.normals, change.offsets.tolist(), strict=True)))
        assert volume(again) == volume(defects.DEFECTS[kind].make(BOX, values, words, {}, 1e-3))


def test_slices_change_nothing_but_the_triangles():
    cut = sliced(CHS, (0, 0, 1), [0.1, 0.35, 0.7])
    assert_closed_manifold_oriented(cut)
    assert volume(cut) == pytest.approx(volume(CHS), rel=1e-13)
    spans = np.sort(cut.vertices[cut.faces][:, :, 2], axis=1)
    for z in (0.1, 0.35, 0.7):
        assert not ((spans[:, 0] < z - 1e-12) & (spans[:, 2] > z + 1e-12)).any()


def test_cuts_beside_or_through_everything_are_refused():
    with pytest.raises(InputError, match="beside the object"):
        defects.slotted(BOX, 0.5, 0.01, 0.05, "+x")
    with pytest.raises(InputError, match="nothing is left"):
        carved(BOX, [((0, 0, 1), -0.1)])
    with pytest.raises(InputError, match="meets no surface"):
        defects.dented(BOX, np.array([2.0, 0, 0]), "-z", 0.06, 0.01, 0.02, 1e-4)


def test_defects_add_up():
    both = defects.slotted(defects.sagged(I, 0.02, "-y", 1e-4), 0.7, 0.01, 0.05, "+x")
    assert_sound(both)
    assert volume(I) - volume(both) == pytest.approx(0.01 * (2 * 0.05 * 0.009 + 0.003 * 0.182), rel=1e-9)


def test_a_cut_along_the_joints_of_a_bent_member_is_refused_in_a_line():
    """Where the plane of a cut runs among the corners that bending made, the wound may cross itself by rounding: told, not crashed."""
    fillet = KINDS["I"].build({"h": 0.2, "b": 0.1, "tw": 0.006, "tf": 0.009, "length": 1.0, "fillet": 0.012}, 1.2e-4).mesh
    bent_one = defects.twisted(defects.sagged(fillet, 0.02, "-y", 1.2e-4), math.radians(8), 1.2e-4)
    for at in (0.3, 0.305):
        try:
            cut = defects.slotted(bent_one, at, 0.005, 0.04, "+x")
        except InputError as error:
            assert "move it a little" in str(error)
        else:
            assert_closed_manifold_oriented(cut)
