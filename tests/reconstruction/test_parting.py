import numpy as np

from predicates import rotation
from scan2fea.kernel.arrangement import Arrangement
from scan2fea.kernel.surfaces import CYLINDER, Surface
from scan2fea.reconstruction.parting import parting
from scan2fea.reconstruction.planar import arranged
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.reconstruction.round_cuts import shapes
from scan2fea.reconstruction.round_growing import Rounds

SIDE, THICK, RADIUS, EACH = 0.3, 0.01, 0.008, 40


def drilled(places, turn):
    """Points on a plate with bores at (k, 2) places, its planes and cylinders; the frame turned by a rotation."""
    rng = np.random.default_rng(0)
    faces = np.r_[np.eye(3), -np.eye(3)]
    half = np.array([SIDE, SIDE, THICK]) / 2
    points, label = [], []
    for k, normal in enumerate(faces):
        own = rng.uniform(-half, half, (400, 3))
        axis = k % 3
        own[:, axis] = half[axis] * normal[axis]
        points.append(own)
        label += [k] * len(own)
    angle = rng.uniform(0, 2 * np.pi, (len(places), EACH))
    walls = np.stack(
        [places[:, :1] + RADIUS * np.cos(angle), places[:, 1:] + RADIUS * np.sin(angle), rng.uniform(-half[2], half[2], angle.shape)], axis=-1
    )
    n_flat = len(label)
    points = np.concatenate([*points, walls.reshape(-1, 3)]) @ turn.T
    surfaces = tuple(Surface(kind=CYLINDER, point=turn @ [x, y, 0.0], axis=turn[:, 2], radius=RADIUS, sense=-1) for x, y in places)
    of = np.full(len(points), -1)
    of[n_flat:] = np.repeat(np.arange(len(places)), EACH)
    planes = Planes(normal=faces @ turn.T, offset=np.abs(faces) @ half, label=np.r_[label, np.full(len(points) - n_flat, -1)], std_m=np.full(6, 1e-6))
    return points, shapes(points, planes, Rounds(surfaces=surfaces, label=of, std_m=np.full(len(places), 1e-6)), 0.004)


def grid(n):
    at = (np.arange(n) - (n - 1) / 2) * SIDE / n
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)


def test_many_bores_in_one_plate_each_cut_their_own_place():
    """Sides of their prisms cut each other's pieces: 36 bores of 8 mm made more than 60,000 of them, and the plate was refused."""
    for turn in (np.eye(3), rotation(2)):
        points, every = drilled(grid(6), turn)
        assert len(parting(points, every)) == 35
        cells, count, group = arranged(points, every, 0.004, 1e-5)
        assert cells.n_cells < 36 * 100
        within = []
        for number in range(36):
            on = np.flatnonzero(np.isin(cells.plane, every.rows(number)) & (count > 0))
            within.append(set(group[cells.cell[on, 0]]))  # their sides look to the axis
            assert len(within[-1]) == 1
        assert len(set().union(*within)) == 36


def test_what_overlaps_is_not_parted_and_no_half_is_cut_by_planes_of_the_other():
    points, every = drilled(np.array([[0.0, 0.0], [0.006, 0.006], [0.1, 0.0]]), np.eye(3))
    apart = parting(points, every)
    assert len(apart) == 1 and 0.014 < abs(apart.offset[0]) < 0.092
    points, every = drilled(grid(4), np.eye(3))
    apart = parting(points, every)
    low, high = points.min(axis=0) - 0.05, points.max(axis=0) + 0.05
    space = Arrangement(apart.normal, apart.offset, low, high)
    assert apart.cut(space, 0) == [0] * 16  # sixteen boxes, one bore in each
    middles = np.array([surface.point for surface in every.rounds.surfaces])
    assert len(np.unique(space.located(middles))) == 16
