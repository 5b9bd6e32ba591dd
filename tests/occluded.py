"""A room of planes with boxes and a pole in it, cast exactly: what stands in the way and what is behind it are known."""

import numpy as np

ROOM = (np.array([-6.0, -5.0, -1.6]), np.array([7.0, 5.0, 2.4]))  # low, high; the station at the origin
BOXES = (
    (np.array([2.5, -0.4, -1.6]), np.array([2.9, 0.4, 0.2])),  # a crate on the floor
    (np.array([-3.0, 1.5, -0.6]), np.array([-2.6, 2.3, 0.5])),  # one that hangs
    (np.array([-1.0, -3.0, -1.6]), np.array([-0.9, -2.9, 2.4])),  # a pole from floor to ceiling
)


def inside_room(direction):
    """(n,) distance from the origin to the room's walls."""
    with np.errstate(divide="ignore"):
        return np.min(np.where(direction > 0, ROOM[1] / direction, ROOM[0] / direction), axis=1)


def to_box(direction, low, high):
    """(n,) distance from the origin to a box, inf where it is missed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = low / direction, high / direction
    near, far = np.nanmax(np.minimum(a, b), axis=1), np.nanmin(np.maximum(a, b), axis=1)
    return np.where((near <= far) & (near > 0), near, np.inf)


def rings(n_columns=1080, elevations_deg=None):
    """(n, 3) directions ring by ring, and the ring of each."""
    e = 1e-3 + np.radians(np.linspace(-30.67, 10.67, 32) if elevations_deg is None else elevations_deg)
    a = np.linspace(-np.pi, np.pi, n_columns, endpoint=False) + 1e-3  # along no axis
    e, a = (x.ravel() for x in np.meshgrid(e, a, indexing="ij"))
    ring = np.repeat(np.arange(len(e) // n_columns), n_columns)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1), ring


def seen(direction, sigma_m=0.02, seed=0, boxes=BOXES):
    """Points, whether each is of something that stands in the way, and the true distance behind it."""
    wall = inside_room(direction)
    front = np.min([to_box(direction, *box) for box in boxes], axis=0) if boxes else np.full(len(wall), np.inf)
    true = np.minimum(wall, front)
    noisy = true + sigma_m * np.random.default_rng(seed).standard_normal(len(true))
    return direction * noisy[:, None], front < wall, wall
