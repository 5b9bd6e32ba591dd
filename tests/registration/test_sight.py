import numpy as np
import pytest

from scan2fea.kernel.transforms import applied, inverse, rigid, rotation_about
from scan2fea.registration.arrange import arrange
from scan2fea.registration.sight import is_station
from scan2fea.registration.surface import common_edge, sees_through, surface_of
from scan2fea.registration.turns import turns
from scan2fea.types import PointCloud, Scan

BLOCK = [((0, 0, 0), (1.2, 0.8, 0.6))]
NOTCHED = [((0, 0, 0), (1.2, 0.8, 0.3)), ((0, 0, 0.3), (0.4, 0.8, 0.6)), ((0.8, 0, 0.3), (1.2, 0.8, 0.6)), ((0, 0.35, 0.3), (1.2, 0.8, 0.6))]
FLOOR = [((-1.5, -1.2, -0.1), (2.4, 2.0, 0.0))]
BESIDE = [((-0.9, -0.2, 0), (-0.5, 0.9, 0.35)), ((1.6, -0.6, 0), (1.9, -0.3, 0.8)), ((0.2, 1.2, 0), (0.9, 1.6, 0.2))]
MIDDLE = np.array([0.6, 0.4, 0.3])
SIGMA = 0.001


def raster(boxes, station, step=0.014, half=0.45, seed=0):
    """Points (n, 3) of the boxes that a scanner at the station ends at, in its own frame, which is turned about z."""
    station = np.asarray(station, float)
    ahead = (MIDDLE - station) / np.linalg.norm(MIDDLE - station)
    side = np.cross([0, 0, 1.0], ahead)
    side /= np.linalg.norm(side)
    a, b = np.meshgrid(*[np.tan(np.arange(-half, half, step))] * 2)
    beam = ahead + a.reshape(-1, 1) * side + b.reshape(-1, 1) * np.cross(ahead, side)
    beam /= np.linalg.norm(beam, axis=1)[:, None]
    ends = np.full(len(beam), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for low, high in boxes:
            t = (np.array([low, high], float)[:, None] - station) / beam
            near, far = t.min(axis=0).max(axis=1), t.max(axis=0).min(axis=1)
            ends = np.where((near < far) & (near > 0), np.minimum(ends, near), ends)
    hit = np.isfinite(ends)
    random = np.random.default_rng(seed)
    T_world_frame = rigid(rotation_about([0.02, 0.01, 1.0], random.uniform(-3, 3)), station)
    points = station + beam[hit] * (ends[hit] + random.normal(0, SIGMA, hit.sum()))[:, None]
    return applied(inverse(T_world_frame), points), T_world_frame


def around(n, phase=0.3):
    return [(0.6 + 3.0 * np.cos(a), 0.4 + 3.0 * np.sin(a), 1.7) for a in 2 * np.pi * (np.arange(n) + phase) / n]


def views(boxes, n):
    scans, poses = zip(*[raster(boxes, s, seed=k) for k, s in enumerate(around(n))], strict=True)
    edge = common_edge(scans)
    return scans, poses, [surface_of(Scan(cloud=PointCloud.of(p)), edge, np.zeros(3)) for p in scans]


def test_the_origin_is_known_for_the_station_where_the_beams_are_even():
    points, T = raster(NOTCHED + FLOOR, around(4)[0])
    assert is_station(points) and is_station(1e3 * points)
    assert not is_station(points - points.mean(axis=0))
    assert not is_station(applied(T, points))
    assert not is_station(points[:5])
    thin, _ = raster([((0, 0, 0), (0.08, 0.08, 2.0)), ((0.8, 0, 0), (0.88, 0.08, 2.0))], around(4)[0])  # three beams wide: most lie at a border
    assert is_station(thin) and not is_station(thin - thin.mean(axis=0))
    k = np.arange(2000) + 0.5  # points as even on a ball round the origin as beams from there would be
    polar, turn = np.arccos(1 - k / 1000), np.pi * (1 + np.sqrt(5)) * k
    ball = 0.1 * np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    assert not is_station(ball) and not is_station(ball * (1 + np.random.default_rng(0).normal(0, 0.003, (2000, 1))))


def test_a_back_on_a_front_fills_what_the_station_looked_through():
    _, poses, surfaces = views(NOTCHED + FLOOR, 4)
    front = int(np.argmin([T[1, 3] for T in poses]))  # the notch opens to -y
    back = (front + 2) % 4
    right = inverse(poses[front]) @ poses[back]
    turned = rigid(rotation_about([0, 0, 1.0], np.pi), 2 * MIDDLE * [1, 1, 0])
    for a, b, T in ((front, back, right), (back, front, inverse(right))):
        assert not sees_through(surfaces[a], surfaces[b], T)
    wrong = inverse(poses[front]) @ turned @ poses[back]
    assert sees_through(surfaces[front], surfaces[back], wrong)
    assert sees_through(surfaces[back], surfaces[front], inverse(wrong))
    blind = surface_of(Scan(cloud=PointCloud.of(surfaces[back].points)), surfaces[back].edge_m)
    assert blind.view is None and not sees_through(surfaces[front], blind, wrong)


def test_half_a_turn_leaves_a_face_on_itself_and_a_quarter_a_square_one():
    u = np.stack(np.meshgrid(np.arange(30) + 0.5, np.arange(20) + 0.5), axis=-1).reshape(-1, 2)
    for points, n in ((u, 1), (u[u[:, 0] < 20], 3)):
        surface = surface_of(Scan(cloud=PointCloud.of(np.c_[points, np.zeros(len(points))])), 1.0)
        found = turns(surface)
        assert len(found) == n
        for H in found:
            moved = applied(H, surface.points)
            assert np.abs(np.sort(moved[:, :2] @ [1.0, 100.0]) - np.sort(surface.points[:, :2] @ [1.0, 100.0])).max() < 1e-6
    angle = np.linspace(0, np.pi, 60)
    bent = np.concatenate([np.c_[9 * np.cos(angle), 9 * np.sin(angle), np.full(60, z)] for z in np.arange(20.0)])
    assert turns(surface_of(Scan(cloud=PointCloud.of(bent)), 1.0)) == []


@pytest.mark.parametrize("boxes, n, placed", [(BLOCK + FLOOR, 4, 1), (NOTCHED + BESIDE + FLOOR, 6, 6)])
def test_a_box_from_all_sides_has_no_place_and_things_that_differ_have(boxes, n, placed):
    scans, poses, _ = views(boxes, n)
    found = arrange([Scan(cloud=PointCloud.of(p)) for p in scans], [None] * n, [False] * n, list("abcdef")[:n])
    assert found.placed.sum() == placed
    assert all(reason for reason, ok in zip(found.reasons, found.placed, strict=True) if not ok)
    first = np.flatnonzero(found.placed)[0]
    for k in np.flatnonzero(found.placed)[1:]:
        centre = scans[k].mean(axis=0)[None]
        off = applied(inverse(found.T_world_frame[first]) @ found.T_world_frame[k], centre) - applied(inverse(poses[first]) @ poses[k], centre)
        assert np.linalg.norm(off) < 3 * found.std_m[k] < 0.3  # told as coarse as it is: cells are 0.1 m wide, and creases hold the slides
