from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from predicates import assert_closed_manifold_oriented, assert_no_crossing, box, extruded, l_beam, moved, rotation, sphere, two_sided
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import volume
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.surfaces import CYLINDER, Surface
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import ReconstructionOptions, planar, reconstruct, strips, visibility
from scan2fea.reconstruction.blurred_faces import placed
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.hanging import Among
from scan2fea.reconstruction.planar import flattened
from scan2fea.reconstruction.plane_growing import Planes, grow_planes, robust_plane, tolerance_m
from scan2fea.reconstruction.round_growing import Rounds
from scan2fea.reconstruction.shapes_found import flat_faces, outlined_faces
from scan2fea.reconstruction.strips import _Left, _own, _placed, _without_backs, rim_offset
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.simulation.shapes import bracket
from scan2fea.types import PointCloud, Scan
from scanned import scanned

T = 0.00635
BEAM = moved(l_beam(length=0.3), rotation(5), np.array([3.0, -2.0, 1.0]))


def test_an_exact_scan_gives_the_exact_solid():
    scan, _, _ = scanned(BEAM, 0.006, seed=1)
    kept = scan.cloud.points.copy()
    found = planar(scan)
    assert np.array_equal(kept, scan.cloud.points)
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(BEAM), rel=1e-6)
    there, back = two_sided(found.mesh, BEAM)
    assert max(there.max(), back.max()) < 1e-6 * 0.3
    assert len(found.mesh.faces) == 20 and len(np.unique(found.mesh.face_region)) == 8  # an L of 12 corners
    assert not failed(found.checks)
    again = planar(scan)
    assert np.array_equal(found.mesh.vertices, again.mesh.vertices) and np.array_equal(found.mesh.faces, again.mesh.faces)


def test_a_surface_that_is_rough_all_over_is_not_looked_at_for_ever(monkeypatch):
    """An angle in noise of 1.6 walls was: 17,000 strips of 2,400 points each, three times, 550 s where 75 do."""
    rng = np.random.default_rng(2)
    smooth = sphere(0.1, 5)
    rough = replace(smooth, vertices=smooth.vertices * (1 + 0.1 * rng.standard_normal((len(smooth.vertices), 1))))
    nothing = Planes(normal=np.zeros((0, 3)), offset=np.zeros(0), label=np.full(len(rough.vertices), -1), std_m=np.zeros(0))
    looked = []
    monkeypatch.setattr(strips, "_placed", lambda points, rows, *_: looked.append(len(rows)))
    spacing = 0.3 / len(rough.vertices) ** 0.5
    strips.with_strips(rough.vertices, nothing, rough, 0.02, spacing, 0.01)
    assert len(rough.vertices) < sum(looked) < (strips.MOST_LOOKS + 1) * len(rough.vertices)


def test_a_cylinder_that_was_tried_and_bounds_nothing_says_nothing_of_the_noise_that_is_left():
    """Five points had told the radius of one to 15 mm: with that as noise 12 planes and 5 holes came as 249 facets."""
    scan = scanned(BEAM, 0.006, 0.1 * T, seed=1)[0]
    first = visibility(scan)
    faces = flat_faces(scan.cloud.points, first)
    tried = Surface(kind=CYLINDER, point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=0.01, sense=1.0)
    rounds = Rounds(surfaces=(tried,), label=np.full(len(scan.cloud), -1), std_m=np.array([1.0]))
    found = flattened(scan, first, faces=replace(faces, rounds=rounds))
    assert found.how["n_cylinders"] == 0
    assert 0 < found.residual_m < 0.5 * 0.1 * T


@pytest.mark.parametrize(("noise", "off"), [(0.1, 0.01), (0.3, 0.03)])
def test_noise_moves_planes_little_and_the_default_takes_them(noise, off):
    scan, _, _ = scanned(BEAM, 0.006, noise * T, seed=1)
    found = reconstruct(scan)
    assert found.how["method"] == "planar", found.how.get("not_planar")
    assert not failed(found.checks)
    assert volume(found.mesh) == pytest.approx(volume(BEAM), rel=off)
    assert 8 <= len(np.unique(found.mesh.face_region)) <= 10  # noise may leave a chamfer
    assert 0 < found.residual_m < 0.5 * noise * T
    free = reconstruct(scan, ReconstructionOptions(flat=False))
    assert free.how["method"] == "visibility" and len(free.mesh.faces) > 1000


def test_points_of_rims_do_not_draw_faces_into_a_wall():
    """Noise of a quarter of the wall, few points: planes fitted to the points within their noise took 5 % of the thickness."""
    tee = np.array([(-0.4, 0.52), (-0.04, 0.52), (-0.04, 0), (0.04, 0), (0.04, 0.52), (0.4, 0.52), (0.4, 0.6), (-0.4, 0.6)])
    truth = moved(extruded(tee, 0.7, 0.35), rotation(3), np.array([1.0, 2.0, -1.0]))
    scan, _, _ = scanned(truth, 0.03, 0.2 * 0.08, seed=4)
    found = planar(scan)
    assert volume(found.mesh) == pytest.approx(volume(truth), rel=0.015)


def test_a_face_settles_where_its_points_scatter_about():
    rng = np.random.default_rng(6)
    truth = moved(box((0.3, 0.2, 0.05)), rotation(8), np.array([0.5, 0.0, 2.0]))
    sigma = 0.01
    _, places, normals = scanned(truth, 0.004, seed=2)
    points = places + sigma * rng.normal(size=places.shape)
    planes = grow_planes(places, normals, 0.004, 0.0)
    solid = flattened(scanned(truth, 0.004, seed=2)[0], visibility(scanned(truth, 0.004, seed=2)[0])).mesh
    off = planes.offset + sigma * rng.uniform(-0.5, 0.5, len(planes))
    back = placed(points, normals, solid, replace(planes, offset=off), sigma)
    held = np.bincount(planes.label)
    assert (np.abs(back.offset - planes.offset) < 5.0 * sigma / np.sqrt(held)).all()
    assert np.array_equal(placed(points, normals, solid, planes, 0.0).offset, planes.offset)


def test_what_is_not_flat_stays_free_form():
    scan, _, _ = scanned(sphere(0.1, rounds=4), 0.009, seed=1)
    found = reconstruct(scan)
    assert found.how["method"] == "visibility" and found.how["not_planar"]
    try:
        assert failed(planar(scan).checks)
    except ReconstructionError as error:
        assert "plane" in str(error)
    pipe = extruded(np.array([[0.03 * np.cos(a), 0.03 * np.sin(a)] for a in 2 * np.pi * np.arange(4) / 4 + np.pi / 4]), 0.06)
    block, _, _ = scanned(pipe, 0.004, seed=1)
    assert reconstruct(block).how["method"] == "planar"  # the same with corners is


def test_a_face_that_is_missing_is_told():
    """The end of a box that nobody scanned: a flat solid through the rest would be a guess."""
    box = extruded(np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.08], [0.0, 0.08]]), 0.05)
    scan, places, _ = scanned(box, 0.004, seed=1)
    open_end = Scan(cloud=scan.cloud.take(places[:, 2] > 1e-6), rays=scan.rays)
    with_end, first = planar(scan), visibility(open_end)
    assert not failed(with_end.checks)
    try:
        found = flattened(open_end, first)
    except ReconstructionError:
        return
    assert failed(found.checks)


def test_planes_do_not_depend_on_place_or_scale():
    scan, places, normals = scanned(BEAM, 0.006, 0.1 * T, seed=1)
    points = scan.cloud.points
    one = grow_planes(points, normals, 0.006, 0.1 * T)
    R, shift = rotation(8), np.array([1.0, 2.0, 3.0])
    two = grow_planes(1000.0 * (points @ R.T) + shift, normals @ R.T, 6.0, 100 * T)
    assert len(one) == len(two) and np.array_equal(one.label, two.label)
    assert np.allclose(one.normal @ R.T, two.normal, atol=1e-9)
    assert np.allclose(1000.0 * one.offset + two.normal @ shift, two.offset, atol=1e-6)
    assert len(places) == len(points)


def test_a_plane_of_mostly_exact_points_is_exact():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (200, 3))
    points[:, 2] = np.where(np.arange(200) < 60, 0.01 * points[:, 2], 0.25)
    points[:60, 2] += 0.24
    plane = robust_plane(points, np.array([0.0, 0.0, 1.0]))
    assert plane.offset == pytest.approx(0.25, abs=1e-12) and plane.normal[2] == pytest.approx(1.0, abs=1e-12)


def test_rim_is_found_without_bias():
    """Two faces that end at u = 1 and the rim between them, all in noise: the mean over draws is the rim."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(40):
        u = np.concatenate([rng.uniform(0.9, 1.0, 300), np.ones(60)]) + 0.004 * rng.normal(size=360)
        found.append(rim_offset(u, 0.998, 0.01, 0.004))
    assert np.mean(found) == pytest.approx(1.0, abs=5e-4) and np.std(found) < 2e-3
    exact = np.concatenate([rng.uniform(0.9, 1.0, 300), np.ones(8)])
    assert rim_offset(exact, 0.995, 0.01, 0.0) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("seed", range(2))
def test_a_bore_is_not_a_ring_of_flats(seed):
    """Each of its flats holds a dozen points and bends within chance; together they are a cylinder."""
    plate = _plate_with_hole(64, 0.012)
    scan, _, _ = scanned(plate, 0.0025, 0.0003, seed=seed)
    assert "bent faces" in {check.name for check in failed(planar_alone(scan))}
    found = reconstruct(scan)
    assert found.how["method"] == "planar" and found.how["n_cylinders"] == 1
    assert volume(found.mesh) == pytest.approx(volume(plate), rel=0.01)  # 0.3 % standard deviation over eight seeds
    assert surface_topology(found.mesh).n_handles == 1


def test_a_hexagonal_hole_is_one():
    scan, _, _ = scanned(_plate_with_hole(6, 0.018), 0.002, 0.0003, seed=1)
    found = reconstruct(scan)
    assert found.how["method"] == "planar" and not found.how["n_cylinders"], found.how.get("not_planar")
    assert surface_topology(found.mesh).n_handles == 1


def planar_alone(scan):
    return flattened(scan, visibility(scan)).checks


def _plate_with_hole(segments, radius):
    return bracket(0.05, 0.06, 0.01, 0.05, [("b", 0.035, 0.025, radius)], chord_m=radius * (1 - np.cos(np.pi / segments)) * 1.0001)


def test_what_hangs_together_with_a_seed_is_the_component_of_it():
    rng = np.random.default_rng(3)
    points, normals = rng.normal(size=(400, 3)), rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    near = k_nearest(points, 7)[1]
    free, plane = rng.random(400) < 0.8, Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.1)
    among = Among.of(points, normals, near)
    sizes = set()
    for seed in range(0, 400, 7):
        for off, reach in ((0.3, np.inf), (0.9, 1.5), (5.0, np.inf)):
            own = free & (np.abs(points[:, 2] - 0.1) <= off) & (normals[:, 2] >= -0.2) & (np.linalg.norm(points - points[seed], axis=1) <= reach)
            graph = coo_array((np.ones(near.size), (np.repeat(np.arange(400), 7), near.ravel())), shape=(400, 400)).tocsr()
            part = connected_components(graph[own][:, own], directed=False)[1]
            wanted = np.flatnonzero(own)[part == part[own[:seed].sum()]] if own[seed] else np.zeros(0)
            assert among.near(seed, free, plane, off, -0.2, reach).tolist() == wanted.tolist()
            sizes.add(len(wanted))
    assert len(sizes) > 5


def backs(points, label, normals, offsets):
    planes = Planes(normal=np.array(normals, float), offset=np.array(offsets, float), label=label, std_m=np.full(len(normals), 1e-9))
    return _without_backs(points, planes, 0.02)


def test_a_few_points_turned_the_wrong_way_are_no_face_of_their_own():
    rng = np.random.default_rng(0)
    top = np.c_[rng.random((500, 2)), np.zeros(500)]
    label = np.where(rng.random(500) < 0.02, 0, 1)
    found = backs(top, label, [[0, 0, -1], [0, 0, 1]], [0.0, 0.0])
    assert found.normal.tolist() == [[0, 0, 1]] and set(found.label) == {-1, 0} and (found.label == 0).sum() == (label == 1).sum()


def test_faces_that_look_apart_beside_each_other_or_through_a_thin_wall_are_two():
    rng = np.random.default_rng(0)
    points = np.c_[rng.random((500, 2)), np.zeros(500)]
    beside = (points[:, 0] < 0.1).astype(int)  # a crank: one face goes on where the other ends, and looks the other way
    assert len(backs(points, beside, [[0, 0, 1], [0, 0, -1]], [0.0, 0.0])) == 2
    through = rng.integers(0, 2, 500)
    points[:, 2] = -0.002 * through
    assert len(backs(points, through, [[0, 0, 1], [0, 0, -1]], [0.0, 0.002])) == 2


def test_faces_of_a_strip_are_those_that_lean_as_its_seed_does_and_lie_as_far_out():
    rng = np.random.default_rng(4)
    middle, area, free = rng.uniform(-1, 1, (300, 3)), rng.uniform(0, 1, 300), rng.random(300) < 0.7
    direction = rng.normal(size=(300, 3)) * [0.4, 0.4, 1.0]
    length = np.linalg.norm(direction, axis=1)
    leans = np.cos(np.radians(35.0))
    for seed in range(0, 300, 11):
        way = direction[seed] / length[seed]
        alike = free & (direction @ way >= leans * length)
        wanted = alike & (np.abs((middle - middle[seed]) @ way) <= 0.3)
        for _ in range(3):
            if not wanted.any():
                break
            way = area[wanted] @ direction[wanted]
            way /= np.linalg.norm(way)
            wanted = alike & (np.abs(middle @ way - np.average(middle[wanted] @ way, weights=area[wanted])) <= 0.3)
        own, total = _own(middle, area, direction, length, seed, free, 0.3)
        assert np.array_equal(own, wanted) and total == pytest.approx(area[wanted].sum())


@pytest.mark.parametrize("lean", [0.0, 32.0])
def test_a_strip_between_an_edge_and_a_hollow_corner_looks_as_its_points_say(lean):
    """The upper rim of a plate two spacings thick on a wall that rises behind it: the first surface rounds both, and leans by 32 degrees."""
    rng = np.random.default_rng(0)
    way, true = (np.array([np.sin(np.radians(a)), 0.0, np.cos(np.radians(a))]) for a in (32.0, lean))
    rim = rng.uniform([0.0, 0.0, 0.0], [2.0, 13.0, 0.0], (24, 3))
    rim[:, 2] = -np.tan(np.radians(lean)) * rim[:, 0]
    wall = rng.uniform([0.0, 0.0, 0.0], [0.0, 13.0, 1.2], (8, 3))
    points = np.concatenate([rim, wall]) + 0.05 * rng.normal(size=(32, 3))
    middle = np.concatenate([rim, wall + [0.3, 0.0, 0.0]])
    every = np.arange(32)
    left = _Left(middle=middle, area=np.ones(32), direction=0.8 * np.tile(way, (32, 1)), length=np.full(32, 0.8), point_face=every, point=every)
    plane = _placed(points, every, left, every >= 0, np.vstack([np.eye(3), -np.eye(3)]), 1.0, 0.05)
    if lean:
        assert plane is None or plane.normal @ true > np.cos(np.radians(10.0))
    else:
        assert plane is not None and plane.normal @ true == 1.0 and plane.offset == pytest.approx(0.0, abs=0.06)


@pytest.mark.parametrize("seed", [1, 2])
def test_rims_narrower_than_the_noise_reaches_are_faces_of_the_outline(seed):
    """Planes grown on 10.8 mm in a noise of 1.1 mm lean up to 37 degrees: 25 faces for 14, and creases that nobody drew."""
    outer, openings = (0.0, 0.0, 0.30, 0.22), [(0.04, 0.05, 0.1, 0.12), (0.18, 0.05, 0.08, 0.12)]
    corners = [[[x, y], [x + a, y], [x + a, y + b], [x, y + b]] for x, y, a, b in (outer, *openings)]
    frame = moved(meshed(prism(corners[0], 0.0108, [loop[::-1] for loop in corners[1:]])), rotation(seed), np.array([0.3, 0.1, 0.2]))
    points = scanned(frame, 0.0045, 0.0011, seed=seed)[0].cloud.points
    found = reconstruct(Scan(cloud=PointCloud.of(points)))
    assert found.how["method"] == "planar" and not failed(found.checks)
    assert len(planar_regions(found.mesh).ids) == 14
    assert volume(found.mesh) == pytest.approx(volume(frame), rel=0.005)


def test_planes_that_are_narrow_all_or_have_lost_their_points_give_no_outline():
    scan, _, _ = scanned(BEAM, 0.006, 0.0006, seed=1)
    first = visibility(scan)
    planes = grow_planes(scan.cloud.points, first.normals, first.spacing_m, first.sigma_m)
    none = replace(planes, label=np.full(len(planes.label), -1))
    assert outlined_faces(scan.cloud.points, first, none) is None
    assert outlined_faces(scan.cloud.points, first, None) is None


@cache
def dense():
    """The beam by two points on its wall: points, first surface, planes as they are grown."""
    scan, _, _ = scanned(BEAM, 0.003, 0.0006, seed=1)
    points, first = scan.cloud.points, visibility(scan)
    return points, first, grow_planes(points, first.normals, first.spacing_m, first.sigma_m)


def test_narrow_planes_that_look_along_wide_ones_need_no_outline():
    """The rims of an angle of 6.35 mm, as they are grown, and one of them made to lean."""
    points, first, planes = dense()
    toes = [k for k in range(4, len(planes)) if abs(planes.normal[k] @ planes.normal[0]) > 0.9]
    assert toes and outlined_faces(points, first, planes) is None
    normal = planes.normal.copy()
    normal[toes] += 0.15 * normal[1]
    normal[toes] /= np.linalg.norm(normal[toes], axis=1)[:, None]
    assert outlined_faces(points, first, replace(planes, normal=normal)) is not None


def test_a_plane_whose_points_leave_most_of_it_bare_is_doubted():
    """Of those points of an angle that lie on none of its faces, spread over all of it."""
    points, first, planes = dense()
    assert outlined_faces(points, first, planes) is None
    way = planes.normal[0] + planes.normal[1]
    way /= np.linalg.norm(way)
    off = np.min(np.abs(points @ planes.normal.T - planes.offset), axis=1) > tolerance_m(first.spacing_m, first.sigma_m)
    assert off.sum() >= 12
    stray = Planes(
        normal=np.vstack([planes.normal, way]),
        offset=np.append(planes.offset, np.median(points[off] @ way)),
        label=np.where(off, len(planes), planes.label),
        std_m=np.append(planes.std_m, planes.std_m.max()),
    )
    outlined = outlined_faces(points, first, stray)
    assert outlined is not None and not np.any(outlined.planes.normal @ way > 0.99)
