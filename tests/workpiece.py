"""Surfaces for the tests: a workpiece without symmetry, seen from different stations."""

import numpy as np

from scan2fea.kernel.transforms import applied, inverse, rigid, rotated
from scan2fea.types import PointCloud, Rays, Scan

BOXES = [  # low corner, high corner, turn about z through its centre; metres, degrees
    ((0, 0, 0), (4, 3, 0.4), 0),
    ((0.5, 0.5, 0.4), (1.3, 1.6, 1.9), 35),
    ((2.4, 0.3, 0.4), (3.7, 0.9, 1.1), -15),
    ((2.1, 1.9, 0.4), (2.9, 2.7, 2.6), 20),
    ((3.2, 1.7, 0.4), (3.6, 2.8, 0.9), -40),
]


def into(box, points):
    """Points in the frame of a box: its low corner, its own axes."""
    low, high, turn = np.array(box[0], float), np.array(box[1], float), np.radians(box[2])
    R = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    centre = 0.5 * (low + high)
    return (points - centre) @ R.T + centre - low, R, high - low


def workpiece(n, seed=0):
    """(n, 3) points on boxes, (n, 3) outward normals; what stands on the base hides it."""
    random = np.random.default_rng(seed)
    points, normals = [], []
    for k, box in enumerate(BOXES):
        low, high = np.array(box[0], float), np.array(box[1], float)
        _, R, size = into(box, np.zeros((1, 3)))
        for axis in range(3):
            m = max(3, round(n * np.prod(np.delete(size, axis)) / 42.0))
            for side in (0, 1):
                p = random.random((m, 3)) * size
                p[:, axis] = side * size[axis]
                outward = np.zeros(3)
                outward[axis] = 2 * side - 1
                if k and axis == 2 and side == 0:
                    continue  # it stands on the base
                points.append((p - size / 2) @ R + 0.5 * (low + high))
                normals.append(np.tile(outward @ R, (m, 1)))
    points, normals = np.concatenate(points), np.concatenate(normals)
    hidden = np.zeros(len(points), bool)
    for box in BOXES[1:]:
        own, _, size = into(box, points)
        hidden |= (own[:, :2] > 1e-9).all(axis=1) & (own[:, :2] < size[:2] - 1e-9).all(axis=1) & (own[:, 2] < size[2] - 1e-9)
    return points[~hidden], normals[~hidden]


def blocked(points, station):
    """True where a box stands between a point and the station (slab test, ends cut off by a hair)."""
    hit = np.zeros(len(points), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for box in BOXES:
            own, _, size = into(box, points)
            direction = into(box, np.asarray(station, float)[None])[0] - own
            a, b = -own / direction, (size - own) / direction
            enter, leave = np.nanmax(np.minimum(a, b), axis=1), np.nanmin(np.maximum(a, b), axis=1)
            hit |= (np.minimum(leave, 1.0) - np.maximum(enter, 0.0)) > 1e-6
    return hit


def seen_from(station, n=20_000, seed=0, sigma=0.0, known=True, T=None):
    """A scan of the workpiece from a station, moved by T (its own frame)."""
    station = np.array(station, float)
    points, normals = workpiece(n, seed)
    facing = np.einsum("nc,nc->n", normals, station - points) > 0.05 * np.linalg.norm(station - points, axis=1)
    points = points[facing & ~blocked(points, station)]
    away = points - station
    distance = np.linalg.norm(away, axis=1)
    points = points + (np.random.default_rng(seed + 1).normal(0, sigma, len(points)) / distance)[:, None] * away
    T = np.eye(4) if T is None else T
    moved, origin = applied(T, points), applied(T, station[None])[0]
    if not known:
        return Scan(cloud=PointCloud.of(moved))
    rays = Rays(origin=np.tile(origin, (len(moved), 1)), direction=rotated(T, away / distance[:, None]), range_m=distance)
    return Scan(cloud=PointCloud.of(moved, ray=np.arange(len(moved))), rays=rays)


def errors(T, truth, points):
    """Radians, and rms metres over the points, between two motions."""
    off = inverse(truth) @ T
    turn = np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1))
    return turn, np.sqrt(((applied(T, points) - applied(truth, points)) ** 2).sum(axis=1).mean())


def scaled(scan, factor):
    rays = scan.rays
    if rays is not None:
        rays = Rays(origin=factor * rays.origin, direction=rays.direction, range_m=factor * rays.range_m)
    return Scan(cloud=scan.cloud.replaced(points=factor * scan.cloud.points), rays=rays)


def identity_at(offset):
    return rigid(np.eye(3), offset)
