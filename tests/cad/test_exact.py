"""Solids whose making is known: true faces, one valid solid in millimetres, volumes of closed forms, the same bytes again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scan2fea.cad.bezier import bernstein, curve
from scan2fea.cad.exact import exact_solid
from scan2fea.cad.readback import read_back
from scan2fea.errors import CadError
from scan2fea.kernel.construction import Carved, Dented, Sagged, Twisted
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed

HOLES = (("a", 0.055, 0.03, 0.009), ("a", 0.055, 0.09, 0.009), ("b", 0.07, 0.06, 0.012))
SHAPES = {
    "L": {"a": 0.16, "b": 0.1, "t": 0.012, "length": 2.0},
    "I": {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092, "length": 1.5, "fillet": 0.012},
    "C": {"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01, "length": 1.4},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.006, "tf": 0.009, "length": 1.0, "fillet": 0.008},
    "RHS": {"h": 0.14, "b": 0.08, "t": 0.006, "length": 1.6},
    "CHS": {"d": 0.1, "t": 0.005, "length": 0.5},
    "round": {"d": 0.05, "length": 0.5},
    "plate": {"b": 0.5, "t": 0.005, "length": 0.8},
    "box": {"x": 0.4, "y": 0.3, "z": 0.2},
    "girder": {"h": 0.4, "b": 0.2, "tw": 0.009, "tf": 0.015, "length": 1.2, "ts": 0.01, "bs": 0.07, "n_stiffeners": 3},
    "table": {"x": 1.2, "y": 0.8, "height": 0.72, "top": 0.03, "leg": 0.06, "inset": 0.05},
    "cylinder": {"d": 0.3, "length": 0.4},
    "sphere": {"d": 0.3},
    "blob": {"d": 0.3, "wave": 0.3, "shape_seed": 5},
    "bracket": {"a": 0.1, "b": 0.12, "t": 0.01, "width": 0.12, "holes": HOLES},
    "tank": {"d": 0.3, "height": 0.3, "t": 0.012},
    "vessel": {"d": 0.3, "length": 0.9},
}
SURFACES = {
    "cylinder": "CYLINDRICAL_SURFACE", "CHS": "CYLINDRICAL_SURFACE", "round": "CYLINDRICAL_SURFACE", "bracket": "CYLINDRICAL_SURFACE",
    "sphere": "SPHERICAL_SURFACE", "tank": "SURFACE_OF_REVOLUTION", "vessel": "SURFACE_OF_REVOLUTION", "blob": "B_SPLINE_SURFACE",
}  # fmt: skip
X, Y, Z = np.eye(3)


def solid(kind, changes=(), volume_m3=None, limit=1e-9, T=None, chord=1e-3):
    shape = KINDS[kind].build(SHAPES[kind], chord)
    T = np.eye(4) if T is None else T
    exact = shape.exact.volume_m3 if volume_m3 is None else volume_m3
    return shape, exact_solid(shape.base, changes, T, posed(shape.mesh, T), exact, limit)


@pytest.mark.parametrize("kind", SHAPES)
def test_every_kind_has_true_faces_and_the_volume_of_its_closed_form(kind):
    T = rigid(random_rotation(np.random.default_rng(3)), [2.0, -1.0, 0.7])
    shape, made = solid(kind, T=T)
    assert made.is_true, made.note
    assert made.n_faces == shape.n_cad_faces
    found = read_back(made.step)
    assert (found.n_solids, found.is_valid, found.n_free_edges) == (1, True, 0)
    assert found.volume_m3 == pytest.approx(shape.exact.volume_m3, rel=1e-9)
    assert found.area_m2 == pytest.approx(shape.exact.area_m2, rel=1e-9)
    assert ".MILLI.,.METRE." in made.step and "Open CASCADE" not in made.step
    assert SURFACES.get(kind, "PLANE") in made.step
    if kind not in ("blob",):
        centre = (found.face_centre * found.face_area[:, None]).sum(0) / found.area_m2
        at = shape.exact.moved(T).centroid
        assert np.linalg.norm(centre - at) < 0.3 * np.ptp(shape.mesh.vertices, axis=0).max()  # where it was put, in metres


@pytest.mark.parametrize("kind", ["I", "CHS", "box", "tank", "sphere"])
def test_a_bent_solid_keeps_its_volume_and_every_face(kind):
    shape = KINDS[kind].build(SHAPES[kind], 1e-3)
    low, high = shape.mesh.vertices[:, 2].min(), shape.mesh.vertices[:, 2].max()
    bends = [Sagged(direction=Y, depth_m=0.02 * (high - low), low=low, high=high), Twisted(angle_rad=0.3, low=low, high=high)]
    _, made = solid(kind, bends, limit=1e-8)
    assert made.is_true, made.note
    assert made.n_faces == shape.n_cad_faces


def test_what_planes_take_away():
    corner = Carved(normals=np.array([[1.0, 1, 1]]), offsets=np.array([0.4 + 0.3 + 0.2 - 0.05]))
    _, made = solid("box", [corner], 0.4 * 0.3 * 0.2 - 0.05**3 / 6)
    assert made.is_true and made.n_faces == 7
    slot = Carved(normals=np.array([Z, -Z, X]), offsets=np.array([0.2, -0.21, 0.0]))
    _, tube = solid("CHS", [slot], KINDS["CHS"].build(SHAPES["CHS"], 1e-3).exact.volume_m3 * (1 - 0.01 / 0.5 / 2))
    assert tube.is_true, tube.note
    _, drum = solid("cylinder", [Carved(normals=np.array([X]), offsets=np.array([0.0]))], math.pi * 0.15**2 * 0.4 / 2)
    assert drum.is_true and drum.n_faces == 4


def test_a_dent_in_a_flat_face_takes_its_formula_and_through_a_wall_nothing():
    dent = Dented(at=np.array([0.2, 0.15, 0.2]), axis=-Z, radius_m=0.06, depth_m=0.01, reach_m=0.02)
    _, made = solid("box", [dent], 0.4 * 0.3 * 0.2 - math.pi * 0.06**2 * 0.01 / 3, 1e-6)  # integrals over trimmed B-splines
    assert made.is_true, made.note
    assert made.n_faces == 7
    wall = Dented(at=np.array([0.04, 0, 0.8]), axis=-X, radius_m=0.03, depth_m=0.004, reach_m=0.01)
    _, tube = solid("RHS", [wall], limit=1e-6)
    assert tube.is_true and tube.n_faces == 12
    _, pipe = solid("CHS", [Dented(at=np.array([0.05, 0, 0.25]), axis=-X, radius_m=0.02, depth_m=0.004, reach_m=0.02)], limit=1e-4)
    assert pipe.is_true, pipe.note


def test_where_no_true_face_can_be_made_facets_stand_in_and_say_why():
    """A dent whose reach ends within a face: the mesh is all there is."""
    dent = Dented(at=np.array([0.0, 0.11, 0.8]), axis=-Y, radius_m=0.01, depth_m=0.001, reach_m=0.05)
    _, made = solid("I", [dent], limit=1e-2)
    assert not made.is_true and "in part only" in made.note
    assert read_back(made.step).n_solids == 1


def test_a_wrong_volume_is_never_called_true():
    _, made = solid("box", volume_m3=0.4 * 0.3 * 0.2 * (1 + 2e-9))
    assert not made.is_true and "instead of" in made.note
    _, made = solid("box", volume_m3=0.4 * 0.3 * 0.2 * (1 + 0.5e-9))
    assert made.is_true


@pytest.mark.parametrize("kind", ["bracket", "blob", "tank"])
def test_the_same_bytes_again_and_nothing_on_the_console(kind, capfd):
    a, b = solid(kind)[1].step, solid(kind)[1].step
    assert a == b and "1970-01-01" in a
    assert capfd.readouterr().out == ""


def test_curves_of_one_piece_are_as_exact_as_asked_or_refused():
    def arc(s):
        return np.stack([np.cos(2 * s), np.sin(2 * s), s], axis=1)

    control = curve(arc, 1e-10)
    test = np.linspace(0, 1, 333)
    assert np.abs(bernstein(test, len(control) - 1) @ control - arc(test)).max() < 1e-9
    assert len(curve(lambda s: np.stack([s, 1 - s, 2 * s], axis=1), 1e-12)) == 2
    with pytest.raises(CadError, match="bends too much"):
        curve(lambda s: np.stack([np.cos(90 * s), np.sin(90 * s), s], axis=1), 1e-10)
