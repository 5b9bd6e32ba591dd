import numpy as np
import pytest

from predicates import box, rotation
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals, volume
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.reconstruction.basins import BACKED, BASIN, BOX, LEAST_VOLUME, NOTHING, _joined, _watershed, parted
from scan2fea.reconstruction.flooding import reached
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_planar import _even_tails
from scan2fea.reconstruction.gates_surface import under_faces
from scan2fea.reconstruction.outside import LEAK_FREE, LEAK_TOLERATED, flood, prepare
from scan2fea.types import PointCloud, Scan
from scanned import DENSITY

H = 0.025


def cube(seed=0):
    """Random points of a unit cube, and their outward normals."""
    mesh = box((1.0, 1.0, 1.0))
    points, face = sample_surface(mesh, int(DENSITY * area(mesh) / H**2), seed)
    a, b, c = (mesh.vertices[mesh.faces[face, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def off_axis(points):
    """Distance from the axis of the top face."""
    return np.linalg.norm(points[:, :2] - 0.5, axis=1)


def tank(wall, mouth, inside, seed=0):
    """A cubic tank with a round opening in its top, whose edge was seen; with the faces inside or without."""
    points, normals = cube(seed)
    open_top = (points[:, 2] > 0.999) & (off_axis(points) < mouth)
    rng = np.random.default_rng(seed + 1)
    angle = rng.uniform(0, 2 * np.pi, int(DENSITY * 2 * np.pi * mouth * wall / H**2))
    edge = np.column_stack([0.5 + mouth * np.cos(angle), 0.5 + mouth * np.sin(angle), 1 - wall * rng.random(len(angle))])
    inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.zeros(len(angle))])
    parts = [(points[~open_top], normals[~open_top]), (edge, inward)]
    if inside:
        within, out = cube(seed + 2)
        within, kept = wall + (1 - 2 * wall) * within, rng.random(len(within)) < (1 - 2 * wall) ** 2
        kept &= ~((within[:, 2] > 1 - wall - 1e-9) & (off_axis(within) < mouth))
        parts.append((within[kept], -out[kept]))
    return tuple(np.concatenate(x) for x in zip(*parts, strict=True))


def right(found, normals):
    return float(np.mean(np.einsum("ij,ij->i", found.signed, normals) > 0))


@pytest.mark.parametrize("turn", [None, 3])
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_a_solid_whose_face_has_a_gap_wider_than_any_ball(turn, scale):
    points, normals = cube()
    gap = (points[:, 2] > 0.999) & (off_axis(points) < 5.5 * H)
    points, normals = scale * points[~gap], normals[~gap]
    if turn is not None:
        points, normals = points @ rotation(turn).T + [3.0 * scale, 0, 0], normals @ rotation(turn).T
    setting = prepare(points)
    assert reached(setting.tetra, 3.5 * setting.spacing_m)[~setting.tetra.is_box].mean() > 0.2, "the gap lets any ball in"
    found = flood(setting, 1.4, core_solid=False)
    assert found.is_parted and found.leak_share <= LEAK_FREE
    assert right(found, normals) > 0.98


def test_a_gap_over_an_edge():
    points, normals = cube()
    gap = np.linalg.norm(points - [0.5, 1.0, 1.0], axis=1) < 5.5 * H
    found = flood(prepare(points[~gap]), 1.4, core_solid=False)
    assert found.is_parted and right(found, normals[~gap]) > 0.98


def test_a_gap_as_wide_as_the_bar_it_is_in():
    """What lies behind is hardly wider than the gap."""
    mesh = box((2.0, 0.14, 0.14))
    points, face = sample_surface(mesh, int(DENSITY * area(mesh) / (0.5 * H) ** 2), 0)
    gap = np.linalg.norm(points - [1.0, 0.07, 0.14], axis=1) < 0.066
    found = flood(prepare(points[~gap]), 1.4, core_solid=False)
    assert found.is_parted and right(found, face_normals(mesh)[face[~gap]]) > 0.98


def test_the_inside_of_a_tank_with_an_opening_is_outside():
    points, normals = tank(0.12, 5.5 * H, inside=True)
    setting = prepare(points)
    outside = parted(setting, 1.4 * setting.spacing_m)
    middle = np.abs(setting.tetra.points[setting.tetra.tets].mean(axis=1) - 0.5).max(axis=1) < 0.2
    assert middle.any() and outside[middle].all()
    assert right(flood(setting, 1.4, core_solid=False), normals) > 0.95


def test_a_tank_scanned_from_outside_alone_is_no_solid():
    points, _ = tank(0.12, 5.5 * H, inside=False)
    found = flood(prepare(points), 1.4, core_solid=False)
    assert found.leak_share > LEAK_TOLERATED


def test_flat_faces_that_carry_on_across_the_gap_make_a_solid():
    points, _ = cube()
    gap = (points[:, 2] > 0.999) & (off_axis(points) < 5.5 * H)
    found = reconstruct(Scan(cloud=PointCloud.of(points[~gap])), ReconstructionOptions())
    assert not failed(found.checks) and found.how["method"] == "planar"
    assert volume(found.mesh) == pytest.approx(1.0, abs=1e-3)


def test_a_tank_scanned_from_outside_with_something_seen_through_its_mouth_is_refused():
    points, _ = cube()
    mouth = (points[:, 2] > 0.999) & (off_axis(points) < 5.5 * H)
    within, _ = cube(1)
    floor = within[(within[:, 2] < 0.001) & (off_axis(within) < 5.5 * H)] * [1, 1, 0] + [0, 0, 0.1]
    found = reconstruct(Scan(cloud=PointCloud.of(np.concatenate([points[~mouth], floor]))), ReconstructionOptions())
    assert failed(found.checks)


def test_nothing_is_parted_where_nothing_leaks():
    points, normals = cube()
    found = flood(prepare(points), 1.4, core_solid=False)
    assert not found.is_parted and right(found, normals) > 0.98


def test_five_sides_stay_open():
    points, normals = cube()
    assert flood(prepare(points[normals[:, 2] < 0.5]), 1.4, core_solid=False).leak_share > LEAK_TOLERATED


def chain(widths, volumes, least=LEAST_VOLUME, widest=np.inf):
    """Tets in a row, the first outside; widths[k] is the facet between k and k + 1."""
    widths = np.asarray(widths, float)
    order = np.argsort(-widths, kind="stable")
    is_box = np.arange(len(widths) + 1) == 0
    return _watershed(order, order + 1, widths[order], np.asarray(volumes, float), is_box, least, widest)


def test_a_basin_is_as_wide_as_its_mouth():
    label, kind = chain([2.0, 5.0], [0, 900, 900])
    assert list(kind[label]) == [BOX, BASIN, BASIN] and label[1] == label[2]
    label, kind = chain([5.0, 2.0], [0, 900, 900])
    assert list(kind[label]) == [BOX, BOX, BOX]


@pytest.mark.parametrize(("held", "told"), [(100.0, BOX), (100.0 + 1e-9, BASIN)])
def test_on_the_limit_of_volume(held, told):
    label, kind = chain([2.0, 9.0], [0, held, 100.0])
    assert kind[label[2]] == told


def test_a_basin_holds_half_a_ball_as_wide_as_its_mouth():
    half = 2 / 3 * np.pi * 6.0**3
    for held, told in ((half - 1.0, BOX), (half + 1.0, BASIN)):
        label, kind = chain([6.0, 9.0], [0, held, 0.0])
        assert kind[label[2]] == told


def test_mouths_beyond_the_widest_are_no_mouths():
    for widest, told in ((2.0, BASIN), (1.999, BOX)):
        label, kind = chain([2.0, 9.0], [0, 900, 900], widest=widest)
        assert kind[label[2]] == told


def test_two_basins_and_a_tet_between_that_goes_where_the_wider_facet_leads():
    label, kind = chain([2.0, 9.0, 1.5, 1.7, 8.0], [0, 500, 500, 1, 500, 500])
    assert list(kind[label]) == [BOX, BASIN, BASIN, BASIN, BASIN, BASIN]
    assert label[1] == label[2] != label[4] and label[3] == label[4] == label[5]


def test_tets_that_no_ball_passes_are_nothing():
    label, kind = _watershed(np.array([0]), np.array([1]), np.array([1.0]), np.ones(3), np.array([True, False, False]), 200.0, 9.0)
    assert list(kind[label]) == [BOX, BOX, NOTHING]


def asked_anew(point, basin, side, n):
    """What `_joined` finds, by asking every basin again whenever one has joined."""
    outside = np.arange(n) == 0
    while True:
        beyond = {(p, 3 - s) for p, b, sides in zip(point, basin, side, strict=True) if outside[b] for s in (1, 2) if sides & s}
        share = np.full(n, 1.0)
        for v in np.flatnonzero(~outside):
            told = [any((p, s) in beyond for s in (1, 2) if sides & s) for p, sides in zip(point[basin == v], side[basin == v], strict=True)]
            share[v] = np.mean(told) if told else 0.0
        if share[~outside].min(initial=1.0) >= BACKED:
            return outside
        outside[np.flatnonzero(~outside)[share[~outside].argmin()]] = True


@pytest.mark.parametrize("seed", range(8))
def test_basins_join_the_outside_one_by_one(seed):
    rng = np.random.default_rng(seed)
    key = np.unique(rng.integers(40 * 9, size=120))
    point, basin, side = key // 9, key % 9, rng.integers(1, 4, len(key))
    assert (_joined(point, basin, side, 9, BACKED) == asked_anew(point, basin, side, 9)).all()


def test_a_pocket_that_is_outside_is_what_lies_behind_the_next_basin():
    point = np.repeat(np.arange(6), 2)
    side = np.tile([1, 2], 6)
    basin = np.array([0, 2, 0, 2, 0, 2, 0, 2, 1, 2, 1, 2])  # 2 has the outside behind four points, and behind two the pocket 1
    assert list(_joined(point, basin, side, 3, 0.7)) == [True, True, False]
    assert list(_joined(point, basin, side, 3, 1.01)) == [True, True, True]


def test_nothing_is_beside_a_basin_of_no_points():
    nothing = np.zeros(0, np.int64)
    assert list(_joined(nothing, nothing, nothing, 2, BACKED)) == [True, True]


def test_what_noise_carries_off_faces_lies_on_both_sides_of_them():
    """Points seen through the mouth of a hollow body lie on one side, and deeper."""
    rng = np.random.default_rng(4)
    face = np.column_stack([0.2 + 0.6 * rng.random((400, 2)), np.ones(400)])
    noise = np.concatenate([np.full(12, 0.015), np.full(10, -0.015), np.full(8, -0.03), np.zeros(370)])
    points = face + noise[:, None] * [0.0, 0.0, 1.0]
    assert _even_tails(box((1.0, 1.0, 1.0)), points, np.abs(noise) / 0.01) == pytest.approx(20 / 400)
    one_sided = np.where(noise > 0.0, 0.0, noise)
    assert _even_tails(box((1.0, 1.0, 1.0)), face + one_sided[:, None] * [0.0, 0.0, 1.0], np.abs(one_sided) / 0.01) == 0.0


@pytest.mark.parametrize(("seen", "passes"), [(True, False), (False, True)])
def test_points_under_a_face_tell_of_a_hollow_only_where_the_face_was_seen(seen, passes):
    rng = np.random.default_rng(5)
    n = 1200
    face = np.column_stack([rng.random((n, 2)), np.ones(n)])
    low = np.hypot(face[:, 0] - 0.5, face[:, 1] - 0.5) < 0.2
    face = face[~low] if not seen else face
    within = np.column_stack([0.45 + 0.1 * rng.random((15, 2)), np.full(15, 0.96)])
    points = np.concatenate([face, within])
    held = np.arange(len(points)) < len(face)
    check = under_faces(box((1.0, 1.0, 1.0)), points, held, points * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0], 1.0 / np.sqrt(n))
    assert check.value == (15 if seen else 0) and check.passed is passes
