"""Solids of members: closed, exact in volume, with the faces a draughtsman draws, and tets that a solver takes."""

import numpy as np
import pytest

from estimation.made import N_FACES, SIZES, closed_area, made
from predicates import assert_closed_manifold_oriented, assert_no_crossing, rotation
from scan2fea.cad import to_brep
from scan2fea.cad.prism import prism_brep
from scan2fea.errors import StageError, UsageError
from scan2fea.estimation.grid import ring_grid
from scan2fea.estimation.layers import LayerOptions, layers_of
from scan2fea.estimation.solid import SolidOptions, cap_triangles, named, solid_of, swept, thinnest_wall
from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.outline import outline_area
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.kernel.quality import tet_dihedrals
from scan2fea.tetmeshing.layers import layered

FAMILIES = tuple(SIZES)


def tets_of(solid, **options):
    at = layers_of(solid, LayerOptions(**options))
    return layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("scale", "shift"), [(1.0, (0, 0, 0)), (1e-3, (0.5, -1, 2)), (20.0, (4e3, -5e3, 300))])
def test_volume_is_area_times_length(family, scale, shift):
    values = {name: scale * v for name, v in SIZES[family].items()}
    member = made(family, 3.048 * scale, values, R=rotation(3), shift=shift, sigma=5e-4 * scale)
    mesh = solid_of(member).mesh
    assert_closed_manifold_oriented(mesh)
    limit = 1e-12 + 1e-14 * np.abs(shift).max() / min(values.values())  # what is left of doubles far from the origin
    assert volume(mesh) == pytest.approx(closed_area(family, values) * 3.048 * scale, rel=limit)


@pytest.mark.parametrize("family", FAMILIES)
def test_regions_are_the_faces_by_name(family):
    solid = solid_of(made(family))
    assert len(solid.face_names) == N_FACES[family] == len(np.unique(solid.mesh.face_region))
    assert_no_crossing(solid.mesh)
    normal = face_normals(solid.mesh)
    for name, z in (("END_FIRST", -1), ("END_LAST", 1)):
        assert np.allclose(normal[solid.mesh.face_region == solid.face_names.index(name)], [0, 0, z])
    if family not in ("CHS", "round"):
        assert len(planar_regions(solid.mesh).ids) == N_FACES[family]


@pytest.mark.parametrize("family", ["L", "I", "C", "T", "RHS"])
def test_fillets_hold_the_area_of_their_arcs(family):
    solid = solid_of(made(family), SolidOptions(root_radius_m=0.004))
    assert_closed_manifold_oriented(solid.mesh)
    assert_no_crossing(solid.mesh)
    assert volume(solid.mesh) == pytest.approx(outline_area(solid.shape) * 1.0, rel=1e-12)
    sign = -1 if family == "RHS" else 1
    assert sign * (outline_area(solid.shape) - closed_area(family, SIZES[family])) > 0
    tets = tets_of(solid)
    assert_closed_manifold_oriented(boundary_surface(tets))
    assert volume(boundary_surface(tets)) == pytest.approx(volume(solid.mesh), rel=1e-11)
    assert tet_dihedrals(tets.nodes, tets.tets).min() > 6.5
    assert np.array_equal(named(tets, solid).face_tag, tets.face_tag)


def test_he_140_a_has_the_area_of_its_table():
    """EN 10365: 31.42 cm2 with root radius 12 mm."""
    solid = solid_of(made("I", 1.0, {"h": 0.133, "b": 0.14, "tw": 0.0055, "tf": 0.0085}), SolidOptions(root_radius_m=0.012))
    assert outline_area(solid.shape) == pytest.approx(31.416e-4, rel=1e-4)


@pytest.mark.parametrize("family", ["L", "I", "CHS", "rect"])
def test_oblique_ends_are_plane_and_cut_where_they_say(family):
    normals = np.array([[0.3, 0.1, -1.0], [-0.2, 0.4, 1.0]])
    solid = solid_of(made(family, 2.0, normals=normals))
    assert_closed_manifold_oriented(solid.mesh)
    for name, normal, at in zip(("END_FIRST", "END_LAST"), normals, (0.0, 2.0), strict=True):
        faces = solid.mesh.faces[solid.mesh.face_region == solid.face_names.index(name)]
        assert np.abs((solid.mesh.vertices[np.unique(faces)] - [0, 0, at]) @ normal).max() < 1e-14
        assert np.allclose(face_normals(solid.mesh)[solid.mesh.face_region == solid.face_names.index(name)], normal / np.linalg.norm(normal))


@pytest.mark.parametrize("family", ["L", "RHS", "round"])
def test_bow_keeps_the_volume_and_the_chord_tolerance(family):
    bow = [[0.006, 0.001], [-0.003, 0.0]]
    member = made(family, 3.0, bow=bow, sigma=0.0)
    solid = solid_of(member, SolidOptions(chord_m=2e-4))
    assert_closed_manifold_oriented(solid.mesh)
    assert volume(solid.mesh) == pytest.approx(closed_area(family, SIZES[family]) * 3.0, rel=1e-12)
    fine = solid_of(member, SolidOptions(chord_m=1e-6))
    assert len(fine.mesh.faces) > len(solid.mesh.faces)
    assert distance_to_mesh(fine.mesh.vertices, solid.mesh).distance.max() <= 2e-4 * (1 + 1e-6)


def test_middle_of_a_bowed_member_lies_where_the_polynomial_says():
    mesh = swept(made("rect", 2.0, bow=[[0.01], [-0.004]], sigma=0.0), SolidOptions(chord_m=1e-5))
    near = mesh.vertices[np.abs(mesh.vertices[:, 2] - 1.0) < 0.05]
    assert near[:, :2].mean(axis=0) == pytest.approx([-0.5 * 0.01, 0.5 * 0.004], abs=2e-4)  # P2(0) = -1/2


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("length", [0.05, 1.0, 12.0])
def test_tets_fill_the_solid_and_are_not_flat(family, length):
    solid = solid_of(made(family, length, R=rotation(1), shift=(3, -2, 8)))
    tets = tets_of(solid)
    surface = boundary_surface(tets)
    assert_closed_manifold_oriented(surface)
    assert volume(surface) == pytest.approx(volume(solid.mesh), rel=1e-11)
    assert tet_dihedrals(tets.nodes, tets.tets).min() > (12 if length <= 1 else 6.5)
    assert len(tets.nodes) < 60_000
    assert tets.face_names == solid.face_names
    assert np.array_equal(named(tets, solid).face_tag, tets.face_tag)  # by nearest face, and as they were made


def test_bent_and_oblique_tets_are_sound():
    member = made("I", 3.0, bow=[[0.005, 0.001], [-0.003, 0.0]], twist=[0.03], normals=[[0.2, 0.1, -1], [0, -0.3, 1]])
    tets = tets_of(solid_of(member), max_nodes=12_000)
    assert_closed_manifold_oriented(boundary_surface(tets))
    assert tet_dihedrals(tets.nodes, tets.tets).min() > 6


def test_asked_edges_are_kept():
    solid = solid_of(made("rect", 0.5))
    assert len(tets_of(solid, edge_m=0.005).tets) > 4 * len(tets_of(solid, edge_m=0.02).tets)


@pytest.mark.parametrize("family", FAMILIES)
def test_cad_of_a_straight_member_is_exact(family):
    member = made(family, 3.048, R=rotation(2), shift=(3, -2, 8))
    solid = solid_of(member)
    brep = prism_brep(solid.shape, solid.sweep)
    assert brep.is_valid and brep.n_solids == 1 and brep.n_free_edges == 0
    assert len(brep.face_kinds) == N_FACES[family]
    assert brep.face_kinds.count("cylinder") == {"CHS": 2, "round": 1}.get(family, 0)
    assert brep.volume_m3 == pytest.approx(closed_area(family, SIZES[family]) * 3.048, rel=1e-10)
    if family not in ("CHS", "round"):  # the way over triangles finds the same planes
        assert to_brep(solid.mesh).face_kinds == ("plane",) * N_FACES[family]


def test_caps_of_tubes_with_other_corners_inside():
    outer = np.array([[0, 0], [2, 0], [3, 1], [3, 3], [0, 3]], float)
    hole = np.array([[0.5, 0.5], [0.5, 2], [2, 2], [2, 0.5]], float)
    corners = np.concatenate([outer, hole])
    a, b, c = corners[cap_triangles([outer, hole])].transpose(1, 0, 2)
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(9 - 0.5 - 2.25)


def test_finer_circles_only_where_noise_and_length_allow():
    n = {(length, sigma): len(solid_of(made("CHS", length, sigma=sigma)).loops[0]) for length in (0.3, 12.0) for sigma in (1e-6, 0.01)}
    assert n[0.3, 1e-6] == 60 and n[12.0, 1e-6] == 12 and n[0.3, 0.01] < n[0.3, 1e-6]


def test_messages_and_input_untouched():
    member = made("L")
    before = member.T_world_member.tobytes(), member.end_normals.tobytes()
    solid_of(member)
    assert before == (member.T_world_member.tobytes(), member.end_normals.tobytes())
    assert thinnest_wall(member.values()) == 0.00635
    with pytest.raises(StageError, match="length of -1"):
        solid_of(made("L", -1.0))
    with pytest.raises(StageError, match="within 6 degrees"):
        solid_of(made("L", normals=[[1, 0, -0.05], [0, 0, 1]]))
    with pytest.raises(StageError, match="too short"):
        solid_of(made("L", 0.05, normals=[[0, 0, -1], [1, 0, 1]]))
    with pytest.raises(UsageError, match=r"t is 0\.2 m"):
        solid_of(made("L", values={"a": 0.127, "b": 0.1, "t": 0.2}))
    with pytest.raises(UsageError, match=r"root radius of 0\.2 m does not fit"):
        solid_of(member, SolidOptions(root_radius_m=0.2))


@pytest.mark.parametrize("n", [12, 24, 36, 48, 60])
@pytest.mark.parametrize("edge", [0.001, 0.03, 0.2])
def test_a_full_round_section_is_covered_once_by_triangles_of_good_angles(n, edge):
    angle = 2 * np.pi * np.arange(n) / n + 0.3
    outer = 0.2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grid = ring_grid([outer], edge)
    a, b, c = (grid.points[grid.triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    area = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    assert area.min() > 0
    assert area.sum() == pytest.approx(n / 2 * np.sin(2 * np.pi / n) * 0.04, rel=1e-12)
    assert len(grid.rim) == n
    assert sorted(grid.rim_edge.tolist()) == list(range(n))
    sides = [np.linalg.norm(p - q, axis=1) for p, q in ((b, c), (c, a), (a, b))]
    sines = np.array([2 * area / (sides[k - 1] * sides[k - 2]) for k in range(3)])
    assert np.degrees(np.arcsin(sines.min())) > 35
    counts = np.bincount(np.sort(grid.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) @ [len(grid.points), 1])
    assert set(counts[counts > 0]) == {1, 2}


def test_long_elements_leave_the_inside_of_a_round_section_coarse():
    angle = 2 * np.pi * np.arange(60) / 60
    outer = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fine, coarse = (ring_grid([outer], edge) for edge in (0.1, 0.25))
    assert len(fine.triangles) == 600
    assert len(coarse.triangles) == 240
