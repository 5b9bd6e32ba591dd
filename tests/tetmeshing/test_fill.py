"""Filling solids: both routes, proved by geometry, and what is said where it cannot be done."""

import dataclasses

import numpy as np
import pytest

from drawn import drawing
from predicates import assert_closed_manifold_oriented, box, l_beam, moved, rotation, sphere, torus
from scan2fea.cad import to_brep
from scan2fea.errors import MeshingError
from scan2fea.kernel.measures import extent, tet_volumes, volume
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.kernel.quality import TET_EDGES, tet_dihedrals
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.tetmeshing.child import run_worker
from scan2fea.tetmeshing.naming import FREEFORM
from scan2fea.types import TriangleMesh


def assert_good(filled, mesh, min_deg=12.0):
    """Positive, conforming, of the volume of the surface, boundary closed and outward, mid nodes half-way, angles as told."""
    tets = filled.tets
    corners = tets.tets[:, :4]
    assert (tet_volumes(tets.nodes, corners) > 0).all()
    assert tet_volumes(tets.nodes, corners).sum() == pytest.approx(volume(mesh), rel=1e-6)
    faces = np.sort(np.concatenate([corners[:, f] for f in ([1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2])]), axis=1)
    once = np.unique(faces, axis=0, return_counts=True)
    assert once[1].max() == 2
    assert np.array_equal(once[0][once[1] == 1], np.unique(np.sort(tets.boundary[:, :3], axis=1), axis=0))
    used, rows = np.unique(tets.boundary[:, :3], return_inverse=True)
    assert_closed_manifold_oriented(TriangleMesh(vertices=tets.nodes[used], faces=rows.reshape(-1, 3)))
    assert np.array_equal(np.unique(tets.tets), np.arange(len(tets.nodes)))
    if tets.order == 2:
        middle = tets.nodes[corners[:, TET_EDGES]].mean(2)
        assert np.array_equal(tets.nodes[tets.tets[:, 4:]], middle)
    worst = tet_dihedrals(tets.nodes, tets.tets).min()
    assert worst > min_deg
    assert filled.how["min_dihedral_deg"] == pytest.approx(worst)
    assert len(tets.face_tag) == len(tets.boundary)
    assert set(np.unique(tets.face_tag)) == set(range(len(tets.face_names)))


def assert_on_their_planes(filled, mesh, brep):
    """Each boundary triangle lies on the plane of the surface region that its named B-Rep face was made from."""
    regions = planar_regions(mesh)
    tets = filled.tets
    for tag, name in enumerate(tets.face_names):
        if name == FREEFORM:
            continue
        row = int(np.searchsorted(regions.ids, brep.region_of_face[brep.face_names.index(name)]))
        tri = tets.nodes[tets.boundary[tets.face_tag == tag][:, :3]]
        assert np.abs((tri - regions.point[row]) @ regions.normal[row]).max() < 1e-6 * extent(mesh.vertices)
        normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
        assert (normal @ regions.normal[row] > 0).all()


@pytest.mark.parametrize(("scale", "shift", "seed"), [(1e-2, 1000.0, 1), (60.0, 1000.0, 2)])
def test_l_beam_from_its_faces_at_any_scale_and_place(scale, shift, seed):
    beam = l_beam(length=0.5, pitch=0.1)
    beam = moved(TriangleMesh(vertices=beam.vertices * scale, faces=beam.faces), rotation(seed), np.full(3, shift))
    brep = to_brep(beam)
    filled = fill(beam, brep)
    assert filled.how["route"] == "brep"
    assert filled.tets.face_names == brep.face_names
    assert_good(filled, beam, min_deg=12)
    assert_on_their_planes(filled, beam, brep)


def test_long_l_beam_of_needles_stays_in_the_budget():
    beam = l_beam(length=3.048)  # 28 long triangles
    filled = fill(beam, to_brep(beam))
    assert_good(filled, beam, min_deg=12)
    assert len(filled.tets.nodes) < 60_000
    assert len(filled.tets.tets) <= 40_000


def test_plate_of_one_element_through_the_wall():
    plate = moved(box((0.5, 0.3, 0.005)), rotation(3), np.ones(3))
    filled = fill(plate, to_brep(plate))
    assert_good(filled, plate, min_deg=12)
    assert filled.how["wall_m"] == pytest.approx(0.005, rel=1e-6)


@pytest.mark.parametrize("solid", [sphere(rounds=3), torus(n=36, m=15)])
def test_free_form_keeps_every_triangle(solid):
    solid = moved(TriangleMesh(vertices=solid.vertices * 0.01, faces=solid.faces), rotation(4), np.full(3, 100.0))
    filled = fill(solid, to_brep(solid))
    assert filled.how["route"] == "surface"
    assert filled.tets.face_names == (FREEFORM,)
    assert_good(filled, solid, min_deg=20)
    corner = {tuple(sorted(map(tuple, t.tolist()))) for t in filled.tets.nodes[filled.tets.boundary[:, :3]]}
    assert corner == {tuple(sorted(map(tuple, t.tolist()))) for t in solid.vertices[solid.faces]}  # to the last bit


def test_kept_surface_with_plane_faces_is_named_by_them():
    beam = l_beam(length=0.2, pitch=0.00635)
    brep = to_brep(beam)
    filled = fill(beam, brep, FillOptions(route="surface"))
    assert filled.how["route"] == "surface"
    assert_good(filled, beam)
    assert filled.tets.face_names == brep.face_names
    assert_on_their_planes(filled, beam, brep)


def test_without_a_brep_regions_give_the_names():
    beam = l_beam(length=0.2, pitch=0.00635)
    assert fill(beam, None).tets.face_names == tuple(f"REGION_{k}" for k in range(8))


def drilled_plate(n=24):
    """Plate 40 x 40 x 8 mm with a hole of n flats, diameter 10 mm: a ring between the hole and the square, closed by walls."""
    angle = 2 * np.pi * np.arange(n) / n
    hole = 0.005 * np.column_stack([np.cos(angle), np.sin(angle)])
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    rim = 0.02 * rim / np.abs(rim).max(1)[:, None]
    flat = np.vstack([hole, rim])
    vertices = np.vstack([np.column_stack([flat, np.zeros(2 * n)]), np.column_stack([flat, np.full(2 * n, 0.008)])])
    i = np.arange(n)
    j = (i + 1) % n
    hole_i, hole_j, rim_i, rim_j, up = i, j, i + n, j + n, 2 * n
    top = [np.column_stack(t) + up for t in ((hole_i, rim_i, rim_j), (hole_i, rim_j, hole_j))]
    bottom = [t[:, ::-1] - up for t in top]
    outside = [np.column_stack(t) for t in ((rim_i, rim_j, rim_j + up), (rim_i, rim_j + up, rim_i + up))]
    inside = [np.column_stack(t) for t in ((hole_i, hole_j + up, hole_j), (hole_i, hole_i + up, hole_j + up))]
    return TriangleMesh(vertices=vertices, faces=np.vstack(top + bottom + outside + inside).astype(np.int64))


def test_facetted_hole():
    """Strips of 1.3 x 8 mm beside elements several times as large."""
    plate = moved(drilled_plate(), rotation(6), np.zeros(3))
    brep = to_brep(plate)
    assert len(brep.face_names) == 6 + 24
    filled = fill(plate, brep)
    assert_good(filled, plate, min_deg=20)
    assert_on_their_planes(filled, plate, brep)


def test_many_holes_have_fewer_edges_round_them_where_the_budget_asks_for_it(tmp_path):
    with drawing() as occ:
        import gmsh

        holes = [(3, occ.addCylinder(8 + 11 * i, 8 + 12 * j, -1, 0, 0, 8, 1.5)) for i in range(2) for j in range(2)]
        occ.cut([(3, occ.addBox(0, 0, 0, 27, 28, 6))], holes)
        occ.synchronize()
        gmsh.write(str(tmp_path / "plate.step"))
    job = {
        "kind": "brep", "step": np.frombuffer((tmp_path / "plate.step").read_bytes(), np.uint8), "shift_mm": np.zeros(3), "size_mm": 6.0,
        "max_size_mm": 36.0, "max_nodes": np.inf, "per_turn": 24.0, "algorithm": "auto", "good_deg": 0.0,
    }  # fmt: skip
    of = {most: run_worker({**job, "max_tets": most}, time_limit_s=60, memory_limit_gib=4) for most in (np.inf, 8_000, 100)}
    n = {most: len(found["tets"]) for most, found in of.items()}
    assert of[np.inf]["per_turn"] == 24 and of[np.inf]["coarser"] == 1
    assert 12 < of[8_000]["per_turn"] < 24 and n[8_000] <= 8_000 < n[np.inf]
    assert of[100]["per_turn"] == 12 and n[100] > 100  # as few as may be, whatever is allowed


def test_two_runs_give_the_same_bytes_and_leave_the_input_alone():
    for solid in (l_beam(length=0.3), sphere(rounds=2)):
        before, brep = solid.vertices.copy(), to_brep(solid)
        a, b = (fill(solid, brep, FillOptions(max_elements=6_000)).tets for _ in range(2))
        for field in dataclasses.fields(a):
            x, y = getattr(a, field.name), getattr(b, field.name)
            assert x == y if isinstance(x, tuple) else x.tobytes() == y.tobytes()
        assert np.array_equal(before, solid.vertices)


def test_options_are_obeyed():
    solid = box()
    brep = to_brep(solid)
    coarse, fine = (fill(solid, brep, FillOptions(edge_m=h, order=1)) for h in (0.5, 0.25))
    assert coarse.tets.order == 1
    assert_good(fine, solid)
    assert len(fine.tets.tets) > 3 * len(coarse.tets.tets)


def test_growth_thins_out_the_inside():
    ball = sphere(rounds=3)
    slow, fast = (fill(ball, None, FillOptions(growth=g)) for g in (0.1, 0.4))
    assert len(fast.tets.tets) < 0.7 * len(slow.tets.tets)


def crossing():
    ball = sphere(rounds=2)
    vertices = ball.vertices.copy()
    vertices[0] *= -1.5  # one vertex pulled through the far side
    return TriangleMesh(vertices=vertices, faces=ball.faces)


@pytest.mark.parametrize(
    ("mesh", "brep", "options", "says"),
    [
        (crossing(), None, FillOptions(), "the surface crosses itself or folds back on itself: repair the surface"),
        (TriangleMesh(vertices=box().vertices, faces=box().faces[:, ::-1].copy()), None, FillOptions(), "inside out or flat"),
        (box(), None, FillOptions(route="brep"), "needs a B-Rep"),
        (box(), None, FillOptions(edge_m=0.0), "edge_m is 0.0 m"),
        (box(), "sphere", FillOptions(), "made from another surface"),
        (l_beam(), "own", FillOptions(edge_m=0.001, time_limit_s=1.0), "stopped after 1 s.*tetmeshing.time_limit_s"),
    ],
)
def test_errors_say_what_to_do(mesh, brep, options, says):
    solid = {"sphere": lambda: to_brep(sphere(rounds=1)), "own": lambda: to_brep(mesh)}.get(brep, lambda: None)()
    with pytest.raises(MeshingError, match=says):
        fill(mesh, solid, options)
