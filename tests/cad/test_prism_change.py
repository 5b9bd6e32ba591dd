"""Members whose section changes along the axis: mesh, B-Rep and tets of the exact volume, planes where faces are plane."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import SIZES, closed_area, made
from predicates import rotation
from scan2fea.cad.prism import prism_brep
from scan2fea.errors import UsageError
from scan2fea.estimation.layers import layers_of
from scan2fea.estimation.solid import SolidOptions, solid_of
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import tet_volumes, volume
from scan2fea.kernel.stretch import stretch_of
from scan2fea.kernel.topology import surface_topology
from scan2fea.tetmeshing import layered
from scan2fea.types import SectionChange

ALL = [("L", "a"), ("L", "b"), ("I", "h"), ("I", "b"), ("C", "h"), ("C", "b"), ("T", "h"), ("T", "b"), ("RHS", "h"), ("RHS", "b"), ("rect", "b")]
ROUNDS = [("CHS", "d"), ("round", "d")]


def changed(family, dimension, factors=(1.0, 1.6), at=(0.0, 1.0), side=0, **options):
    size = SIZES[family][dimension]
    change = SectionChange(
        kind="taper", dimension=dimension, z_m=np.array(at) * 1.0, value_m=size * np.array(factors), std_m=np.full(len(at), 1e-4), side=side
    )
    return replace(made(family, 1.0, R=rotation(2), shift=(4, 5, 6), **options), change=change)


def true_volume(member):
    change = member.change
    total = 0.0
    for k in range(len(change.z_m) - 1):
        ends = change.value_m[k : k + 2]
        areas = [closed_area(member.family, {**member.values(), change.dimension: v}) for v in (ends[0], ends.mean(), ends[1])]
        total += (change.z_m[k + 1] - change.z_m[k]) * (areas[0] + 4 * areas[1] + areas[2]) / 6
    return total


@pytest.mark.parametrize(("family", "dimension"), ALL + ROUNDS)
def test_a_taper_is_a_solid_of_its_exact_volume(family, dimension):
    member = changed(family, dimension)
    solid = solid_of(member)
    true, is_round = true_volume(member), family in ("CHS", "round")
    topology = surface_topology(solid.mesh)
    assert topology.is_closed and topology.is_manifold
    assert volume(solid.mesh) == pytest.approx(true, rel=1e-10)
    brep = prism_brep(solid.shape, solid.sweep)
    assert brep.is_valid and brep.n_solids == 1 and brep.n_free_edges == 0
    assert brep.volume_m3 == pytest.approx(true, rel=1e-6)
    if not is_round:
        assert set(brep.face_kinds) == {"plane"}


@pytest.mark.parametrize("side", [-1, 0, 1])
def test_a_haunch_keeps_the_faces_that_go_on_in_their_plane(side):
    member = changed("I", "h", (1.8, 1.0, 1.0, 1.4), (0.0, 0.3, 0.8, 1.0), side)
    solid = solid_of(member)
    brep = prism_brep(solid.shape, solid.sweep)
    assert volume(solid.mesh) == pytest.approx(true_volume(member), rel=1e-10)
    assert brep.volume_m3 == pytest.approx(true_volume(member), rel=1e-6) and set(brep.face_kinds) == {"plane"}
    spans = {name.split("_SPAN_")[0] for name in brep.face_names if "_SPAN_" in name}
    moved = {"TOP_OUTER", "TOP_INNER_LEFT", "TOP_INNER_RIGHT"}, {"BOTTOM_OUTER", "BOTTOM_INNER_LEFT", "BOTTOM_INNER_RIGHT"}
    assert spans == {-1: moved[0], 0: moved[0] | moved[1], 1: moved[1]}[side]
    assert "WEB_LEFT" in brep.face_names and len(set(brep.face_names)) == len(brep.face_names)


@pytest.mark.parametrize(("family", "dimension"), [("I", "h"), ("RHS", "b"), ("CHS", "d"), ("L", "a")])
def test_tets_fill_it_and_meet_its_knots(family, dimension):
    member = changed(family, dimension, (1.5, 1.0, 1.0), (0.0, 0.37, 1.0))
    solid = solid_of(member)
    at = layers_of(solid)
    tets = layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names)
    volumes = tet_volumes(tets.nodes, tets.tets[:, :4])
    assert volumes.min() > 0 and volumes.sum() == pytest.approx(volume(solid.mesh), rel=1e-9)
    z = (at.points - member.T_world_member[:3, 3]) @ member.T_world_member[:3, 2]
    assert np.abs(z - 0.37).min() < 1e-12


def test_fillets_move_as_a_whole():
    member = changed("I", "h")
    solid = solid_of(member, SolidOptions(root_radius_m=0.012))
    brep = prism_brep(solid.shape, solid.sweep)
    assert brep.is_valid and "nurbs" in brep.face_kinds
    plain = true_volume(member)
    assert brep.volume_m3 - plain == pytest.approx(4 * (1 - np.pi / 4) * 0.012**2, rel=1e-3)


def test_oblique_ends_and_bow_go_together_with_a_taper():
    member = changed("RHS", "h", normals=((0.1, 0.05, -1), (0, 0.1, 1)), bow=[[0.004], [0.0]])
    solid = solid_of(member)
    brep = prism_brep(solid.shape, solid.sweep)
    assert brep.is_valid and brep.volume_m3 == pytest.approx(volume(solid.mesh), rel=2e-3)


@pytest.mark.parametrize(("family", "dimension"), ALL + ROUNDS)
def test_points_go_back_to_the_least_section(family, dimension):
    member = changed(family, dimension, (1.0, 1.5, 1.2), (0.0, 0.6, 1.0))
    points = sample_surface(solid_of(member).mesh, 500, 1)[0]
    local = sweep_of_member(member).coordinates(points)
    plain = replace(member, change=None, T_world_member=np.eye(4))
    mesh = solid_of(plain, SolidOptions(n_chords=48)).mesh
    away = PointToMesh(mesh).nearest(local).distance
    assert away.max() < (4e-3 if family in ("CHS", "round") else 1e-9) * max(SIZES[family].values())


def test_what_cannot_change_is_told():
    with pytest.raises(UsageError, match="cannot change"):
        stretch_of("I", SIZES["I"], "tw")
