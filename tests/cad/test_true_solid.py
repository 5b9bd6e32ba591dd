"""Solids of true faces: planes, cylinders, cones and spheres found in noisy triangles, their relations, the file and the mesh of it."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from drawn import drawing, triangles
from predicates import box, rotation, torus
from scan2fea.cad import CadOptions, assembly, true_solid
from scan2fea.cad.compared import Scale, points_lost
from scan2fea.cad.patches import segmented
from scan2fea.cad.readback import read_back
from scan2fea.cad.resting import resting_planes
from scan2fea.cad.roundings import smooth_share, unexplained, without_roundings
from scan2fea.fea.elements import surface_volume
from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.measures import volume
from scan2fea.kernel.quality import scaled_jacobian
from scan2fea.repair import repair
from scan2fea.simulation.freeform import blob
from scan2fea.tetmeshing import fill
from scan2fea.types import TriangleMesh

EDGE = 0.004
PLATE = 0.12 * 0.08 * 0.01 - np.pi * 0.01 * (0.01**2 + 2 * 0.006**2)
CUP = np.pi * (0.05**2 * 0.02 - 0.008**2 * 0.06) + np.pi * 0.04 / 3 * (0.035**2 + 0.035 * 0.015 + 0.015**2)


@functools.cache
def meshed(kind):
    """Triangles of an exact body, about EDGE long, in metres."""
    with drawing() as occ:
        if kind == "plate":
            body = [(3, occ.addBox(0, 0, 0, 0.12, 0.08, 0.01))]
            tools = [(3, occ.addCylinder(x, y, -0.01, 0, 0, 0.03, r)) for x, y, r in ((0.03, 0.04, 0.01), (0.07, 0.02, 0.006), (0.1, 0.06, 0.006))]
            occ.cut(body, tools)
        elif kind == "cup":
            body, _ = occ.fuse([(3, occ.addCylinder(0, 0, 0, 0, 0, 0.02, 0.05))], [(3, occ.addCone(0, 0, 0.02, 0, 0, 0.04, 0.035, 0.015))])
            occ.cut(body, [(3, occ.addCylinder(0, 0, -0.01, 0, 0, 0.1, 0.008))])
        elif kind == "pocket":
            occ.cut([(3, occ.addBox(0, 0, 0, 0.12, 0.08, 0.03))], [(3, occ.addBox(0.05, 0.03, 0.028, 0.012, 0.012, 0.01))])
        else:
            body = [(3, occ.addBox(0, 0, 0, 0.1, 0.1, 0.03))]
            occ.fuse(body, [(3, occ.addSphere(0.05, 0.05, 0.03, 0.025))])
        mesh = triangles(EDGE)
    return mesh if volume(mesh) > 0 else TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])


def noisy(mesh, sigma, seed=0):
    return TriangleMesh(vertices=mesh.vertices + sigma * np.random.default_rng(seed).standard_normal(mesh.vertices.shape), faces=mesh.faces)


def solid_of(mesh, sigma, **options):
    return true_solid(mesh, mesh.vertices, CadOptions(**options), spacing_m=EDGE, noise_m=sigma)


@functools.cache
def solid(kind, sigma):
    """Of a body of `meshed`, for all tests that look at it."""
    return solid_of(noisy(meshed(kind), sigma), sigma)


@pytest.mark.parametrize(("sigma", "off"), [(0.0, 1e-9), (1e-4, 2e-3), (3e-4, 6e-3)])
def test_a_plate_with_holes_has_a_face_for_each_side_and_hole(sigma, off):
    found = solid("plate", sigma)
    assert found.reason == ""
    brep = found.brep
    assert sorted(brep.face_kinds) == ["cylinder"] * 3 + ["plane"] * 6
    assert sorted(n for n in brep.face_names if n.startswith("HOLE")) == ["HOLE_01", "HOLE_02", "HOLE_03"]
    assert brep.volume_m3 == pytest.approx(PLATE, rel=off)
    back = read_back(brep.step)
    assert back.is_valid
    assert (back.n_solids, back.n_free_edges, len(back.face_area)) == (1, 0, 9)
    assert "SI_UNIT(.MILLI.,.METRE.)" in brep.step
    for name in brep.face_names:
        assert brep.step.count(f"ADVANCED_FACE('{name}'") == 1


def test_relations_that_hold_are_applied_exactly_and_told():
    found = solid("plate", 1e-4)
    relations = {snap.relation for snap in found.snaps if snap.applied}
    assert {"parallel", "orthogonal", "equal radius"} <= relations
    assert all(0 <= snap.p_value <= 1 and snap.applied == (snap.p_value >= 0.01) for snap in found.snaps)


def test_a_right_angle_that_the_data_refuse_stays_as_measured():
    mesh = meshed("plate")
    sheared = TriangleMesh(vertices=mesh.vertices + np.outer(mesh.vertices[:, 2], [0.0, 0.02, 0.0]), faces=mesh.faces)  # 1.15 deg
    found = solid_of(noisy(sheared, 2e-5), 2e-5)
    refused = [snap for snap in found.snaps if snap.relation == "orthogonal" and not snap.applied]
    assert any(snap.off == pytest.approx(0.02, rel=0.2) for snap in refused)


def test_cylinders_and_cones_on_one_axis():
    found = solid("cup", 1e-4)
    assert sorted(found.brep.face_kinds) == ["cone", "cylinder", "cylinder", "plane", "plane", "plane"]
    assert found.brep.volume_m3 == pytest.approx(CUP, rel=3e-3)
    assert any(snap.relation == "concentric" and snap.applied for snap in found.snaps)


def test_a_cone_that_few_faces_do_not_tell_from_balls_is_one_cone():
    """A flange whose neck bends by two standard deviations over the faces of a seed: it came as two balls, 0.9 % short."""
    with drawing() as occ:
        body, _ = occ.fuse([(3, occ.addCylinder(0, 0, 0, 0, 0, 0.015, 0.08))], [(3, occ.addCone(0, 0, 0.015, 0, 0, 0.04, 0.045, 0.035))])
        occ.cut(body, [(3, occ.addCylinder(0, 0, -0.01, 0, 0, 0.1, 0.025))])
        mesh = repair(triangles(EDGE)).mesh
    held = np.pi * (0.08**2 * 0.015 + 0.04 / 3 * (0.045**2 + 0.045 * 0.035 + 0.035**2) - 0.025**2 * 0.055)
    for seed in range(3):
        found = solid_of(noisy(mesh, 3e-4, seed), 3e-4)
        assert sorted(found.brep.face_kinds) == ["cone", "cylinder", "cylinder", "plane", "plane", "plane"]
        assert found.brep.volume_m3 == pytest.approx(held, rel=3e-3)


def test_walls_that_look_next_to_opposite_ways_do_not_make_an_end_a_rounding():
    """The end of a leg narrower than the reach, whose four walls lean by chance: enough of their normals together look any way."""
    leg = box((0.04, 0.04, 0.3), 0.01)
    mesh = noisy(leg, 3e-4, 1)
    found = segmented(mesh, 1.1e-3)
    assert len(found.surfaces) == 6
    assert len(without_roundings(mesh, found, 0.021).surfaces) == 6


def test_the_foot_of_another_leg_does_not_make_an_end_a_rounding():
    first = box((0.04, 0.04, 0.3), 0.01)
    mesh = TriangleMesh(
        vertices=np.concatenate([first.vertices, first.vertices + [0.3, 0, 0]]),
        faces=np.concatenate([first.faces, first.faces + len(first.vertices)]),
    )
    assert len(without_roundings(mesh, segmented(mesh, 1e-4), 0.021).surfaces) == 12


def test_a_dome_is_a_sphere():
    found = solid_of(noisy(meshed("dome"), 1e-4), 1e-4)
    assert found.brep.face_kinds.count("sphere") == 1
    assert found.brep.face_kinds.count("plane") == 6
    assert found.brep.volume_m3 == pytest.approx(0.1 * 0.1 * 0.03 + 2 / 3 * np.pi * 0.025**3, rel=2e-3)
    assert volume(boundary_surface(fill(found.mesh, found.brep).tets)) == pytest.approx(found.brep.volume_m3, rel=3e-3)


def test_wherever_it_stands_it_is_the_same_solid():
    mesh = meshed("plate")
    turned = TriangleMesh(vertices=mesh.vertices @ rotation(3).T + 100.0, faces=mesh.faces)
    a, b = solid("plate", 0.0), solid_of(turned, 0.0)
    assert sorted(a.brep.face_kinds) == sorted(b.brep.face_kinds)
    assert b.brep.volume_m3 == pytest.approx(a.brep.volume_m3, rel=1e-7)


def test_the_same_surface_gives_the_same_bytes_and_is_left_alone():
    mesh = noisy(meshed("cup"), 1e-4)
    kept = mesh.vertices.copy()
    assert solid_of(mesh, 1e-4).brep.step == solid("cup", 1e-4).brep.step
    assert np.array_equal(mesh.vertices, kept)


def test_free_form_is_told_and_given_back():
    mesh = torus(0.1, 0.03)
    found = true_solid(mesh, mesh.vertices, spacing_m=0.005, noise_m=0.0)
    assert found.brep is None
    assert "lies on no plane" in found.reason


def test_pieces_of_a_free_form_are_not_cut_with_each_other(monkeypatch):
    body = blob(0.2, 0.3, 3, 0.0008).mesh

    def never(*_):
        raise AssertionError("the cells of pieces that pass smoothly into each other take minutes")

    monkeypatch.setattr("scan2fea.cad.solid.cell_solid", never)
    found = true_solid(body, body.vertices, spacing_m=0.004, noise_m=0.001)
    assert found.brep is None
    assert "a free form" in found.reason


def test_borders_are_smooth_where_surfaces_touch_and_sharp_where_they_meet():
    sharp = meshed("plate")
    assert smooth_share(sharp, segmented(sharp, 1e-6)) == 0
    body = blob(0.2, 0.3, 3, 0.0004).mesh
    assert smooth_share(body, segmented(body, 0.003)) > 0.9


def a_leg(edge=0.012):
    """(surface of a square leg whose edges and lower end a coarse scan has rounded, points measured on its sides and top, points where it stands)."""
    grid = box((0.06, 0.06, 0.4), edge)
    v = grid.vertices - [0.03, 0.03, 0.0]
    off = np.hypot(v[:, 0], v[:, 1])
    v[:, :2] *= np.where(off > 0.04, 0.935, 1.0)[:, None]  # the edges
    low = (v[:, 2] < 1e-9) & (off > 0.015)
    v[low, 2] += 0.08 * (off[low] - 0.015)  # the end
    rng = np.random.default_rng(0)
    n = 1500
    u, z = rng.uniform(-0.03, 0.03, n), rng.uniform(0.0, 0.4, n)
    walls = np.concatenate([np.stack(p, axis=1) for p in ((u, np.full(n, 0.03), z), (u, np.full(n, -0.03), z),
                                                          (np.full(n, 0.03), u, z), (np.full(n, -0.03), u, z))])  # fmt: skip
    top = np.stack([u, rng.permutation(u), np.full(n, 0.4)], axis=1)
    seen = np.concatenate([walls, top]) + rng.normal(0, 0.0003, (5 * n, 3))
    stands = np.stack([*rng.uniform(-0.03, 0.03, (2, 30)), np.zeros(30)], axis=1)
    return TriangleMesh(vertices=v, faces=grid.faces), seen, (stands, np.tile([0.0, 0.0, -1.0], (30, 1)))


def test_a_narrow_leg_keeps_its_flat_sides_and_the_end_it_stands_on():
    mesh, seen, stands = a_leg()
    found = true_solid(mesh, seen, spacing_m=0.012, noise_m=0.0003, resting=stands)
    assert found.reason == ""
    assert found.brep.face_kinds == ("plane",) * 6
    assert found.brep.volume_m3 == pytest.approx(0.06 * 0.06 * 0.4, rel=3e-3)


def test_points_on_two_supports_are_two_planes():
    rng = np.random.default_rng(0)
    floor = np.c_[rng.uniform(0, 1, (30, 2)), np.zeros(30)]
    wall = np.c_[np.ones(20), rng.uniform(0, 1, (20, 2))]
    few = np.c_[rng.uniform(0, 1, (5, 2)), np.full(5, 0.4)]
    normals = np.concatenate([np.tile(n, (k, 1)) for n, k in (((0, 0, -1.0), 30), ((1.0, 0, 0), 20), ((0, 0, -1.0), 5))])
    found = resting_planes(np.concatenate([floor, wall, few]), normals, 0.001)
    assert [len(r.points) for r in found] == [30, 20]
    np.testing.assert_allclose([r.surface.axis for r in found], [(0, 0, -1), (1, 0, 0)])


def test_it_can_be_switched_off():
    assert solid_of(meshed("plate"), 0.0, true_faces=False).reason == "cad.true_faces is off"


def test_tets_carry_the_names_of_the_faces_and_the_volume_of_the_solid():
    found = solid("plate", 1e-4)
    tets = fill(found.mesh, found.brep).tets
    assert set(tets.face_names) == set(found.brep.face_names)
    assert set(np.unique(tets.face_tag)) == set(range(len(tets.face_names)))
    surface = boundary_surface(tets)
    assert volume(surface) == pytest.approx(found.brep.volume_m3, rel=3e-3)  # corners are joined by chords
    assert surface_volume(tets.nodes, tets.boundary) == pytest.approx(found.brep.volume_m3, rel=1e-5)  # quadratic edges follow the holes
    assert scaled_jacobian(tets.nodes, tets.tets).min() > 0
    hole = tets.face_names.index("HOLE_01")
    corners = tets.nodes[tets.boundary[tets.face_tag == hole][:, :3]].reshape(-1, 3)
    flat = corners - corners.mean(0)
    assert np.linalg.svd(flat, compute_uv=False)[2] > 0.05 * len(corners) ** 0.5 * EDGE  # round, not flat


def test_it_goes_into_an_assembly():
    found = solid("plate", 0.0)
    back = read_back(assembly([found.brep, found.brep], ["A", "B"], [(1, 0, 0), (0, 1, 0)]))
    assert back.n_solids == 2
    assert back.is_valid


def test_patches_along_rounded_creases_are_given_up_but_the_wall_of_a_hole_is_not():
    mesh = noisy(meshed("plate"), 3e-4)
    patches = segmented(mesh, 1e-3)
    kept = without_roundings(mesh, patches, 0.009)
    assert sorted(s.kind for s in kept.surfaces) == ["cylinder"] * 3 + ["plane"] * 6
    assert unexplained(mesh, kept, 0.009) == 0
    lost = replace(patches, label=np.where(patches.label == np.bincount(patches.label[patches.label >= 0]).argmax(), -1, patches.label))
    assert unexplained(mesh, lost, 1e-3) > 0.1


@pytest.mark.parametrize(("share", "kept"), [(0.19, False), (0.21, True)])
def test_a_narrow_face_that_the_points_ask_for_is_no_rounding(share, kept):
    """The side of a slot 20 long in a plate 10 thick, all of it within the reach of the ends and of top or bottom."""
    with drawing() as occ:
        ends = [(3, occ.addCylinder(x, 0.04, -0.01, 0, 0, 0.03, 0.01)) for x in (0.05, 0.07)]
        occ.cut([(3, occ.addBox(0, 0, 0, 0.12, 0.08, 0.01))], [*ends, (3, occ.addBox(0.05, 0.03, -0.01, 0.02, 0.02, 0.03))])
        mesh = repair(triangles(0.002)).mesh
    found = segmented(mesh, 1e-5)
    assert len(found.surfaces) == 10
    one = next(k for k, s in enumerate(found.surfaces) if s.kind == "plane" and abs(s.point[1] - 0.03) < 1e-4)
    rows = np.flatnonzero(found.label == one)
    n = 100
    middle, rim = np.array([0.06, 0.03, 0.005]), np.array([0.06, 0.03, 0.0])
    points = np.concatenate([np.tile(middle, (round(share * n), 1)), np.tile(rim, (n - round(share * n), 1))])
    gone = len(without_roundings(mesh, found, 0.0065).surfaces)
    assert gone == 8
    assert len(without_roundings(mesh, found, 0.0065, (), (points, np.full(n, rows[0]), 1e-4)).surfaces) == gone + kept


@pytest.mark.parametrize(("depth", "told"), [(0.002, True), (0.0, False)])
def test_a_shallow_pocket_that_the_solid_leaves_out_is_told(depth, told):
    """0.8 % of the surface and 2 mm deep: within 95 % of the surface, the largest distance, the volume and the count of holes."""
    pocket, plain = meshed("pocket"), box((0.12, 0.08, 0.03))
    flat = np.where((pocket.vertices[:, 2] > 0.027) & (pocket.vertices[:, 2] < 0.03), 0.03, pocket.vertices[:, 2])
    surface = pocket if depth else TriangleMesh(vertices=np.c_[pocket.vertices[:, :2], flat], faces=pocket.faces)
    rng = np.random.default_rng(5)
    corners = surface.vertices[surface.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    weights = rng.dirichlet((1.0, 1.0, 1.0), 30_000)
    points = np.einsum("ni,nij->nj", weights, corners[rng.choice(len(area), 30_000, p=area / area.sum())])
    points += 5e-5 * rng.standard_normal(points.shape)
    lost = points_lost(plain, surface, points, Scale(spacing_m=0.001, noise_m=5e-5, size_m=0.15))
    assert (lost >= 100) if told else lost == 0


def test_the_report_tells_how_wide_each_hole_is():
    sigma = 1e-4
    rows = solid("plate", sigma).how["cylinders"]
    wide = sorted(row["diameter_m"] for row in rows)
    assert [row["name"] for row in rows] == ["HOLE_01", "HOLE_02", "HOLE_03"] and all(row["is_hole"] for row in rows)
    assert wide == pytest.approx([0.012, 0.012, 0.02], abs=4e-5)
    assert all(2e-6 < row["std_m"] < 5e-5 and row["n_points"] > 20 for row in rows)
