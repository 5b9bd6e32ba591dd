"""Holes drilled into the solid of a member: a true cylinder each, all else as it was."""

import numpy as np
import pytest

from scan2fea.cad import drilled, prism_brep
from scan2fea.errors import CadError
from scan2fea.kernel.measures import volume
from scan2fea.kernel.outline import outline
from scan2fea.kernel.sweep import Sweep
from scan2fea.kernel.topology import surface_topology
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.types import RoundHole

SIZES = {"a": 0.1, "b": 0.08, "t": 0.01}
LENGTH, RADIUS = 0.5, 0.009


def beam(T, bow=0.0):
    ends = np.array([[0.0, 0, -1], [0, 0, 1]])
    sweep = Sweep(T_world_member=T, length_m=LENGTH, bow=np.array([[bow], [0.0]]), twist=np.zeros(0), end_normals=ends)
    return prism_brep(outline("L", SIZES, 0.012), sweep)


def hole(T, x, z, radius=RADIUS):
    """Through the leg along x, from its outer face."""
    at = T[:3, :3] @ [x, 0.0, z] + T[:3, 3]
    told = {"std_m": 1e-4, "place_std_m": 1e-4, "n_points": 50}
    return RoundHole(face="A_OUTER", start=at, through=T[:3, :3] @ [0.0, SIZES["t"], 0.0], radius_m=radius, **told)


@pytest.mark.parametrize("seed", [None, 3])
def test_each_hole_is_one_more_face_and_takes_its_volume(seed):
    T = np.eye(4) if seed is None else rigid(random_rotation(seed), np.array([12.0, -7.0, 3.0]))
    base = beam(T)
    found = drilled(base, [hole(T, 0.06, 0.05), hole(T, 0.06, 0.4)])
    assert sorted(found.brep.face_names) == sorted([*base.face_names, "HOLE_01", "HOLE_02"])
    kinds = dict(zip(found.brep.face_names, found.brep.face_kinds, strict=True))
    assert kinds["HOLE_01"] == "cylinder" and kinds["A_OUTER"] == "plane" and kinds["ROOT_1"] == "cylinder"
    left = base.volume_m3 - 2 * np.pi * RADIUS**2 * SIZES["t"]
    assert found.brep.volume_m3 == pytest.approx(left, rel=1e-6)
    assert surface_topology(found.mesh).n_handles == 2
    assert volume(found.mesh) == pytest.approx(left, rel=2e-3)
    for name, centre in zip(found.brep.face_names, found.brep.face_centre, strict=True):
        own = found.mesh.faces[found.mesh.face_region == found.brep.face_names.index(name)]
        assert np.linalg.norm(found.mesh.vertices[own].mean((0, 1)) - centre) < LENGTH
        if name.startswith("HOLE"):
            z = 0.05 if name == "HOLE_01" else 0.4
            assert np.allclose(T[:3, :3].T @ (centre - T[:3, 3]), [0.06, SIZES["t"] / 2, z], atol=1e-9)
        assert f"'{name}'" in found.brep.step


def test_a_bent_member_is_drilled_too():
    T = np.eye(4)
    found = drilled(beam(T, bow=2e-3), [hole(T, 0.06, 0.25)])
    assert "HOLE_01" in found.brep.face_names and found.brep.is_valid


def test_a_hole_across_an_edge_is_told():
    T = np.eye(4)
    with pytest.raises(CadError, match="hole"):
        drilled(beam(T), [hole(T, 0.095, 0.25)])
