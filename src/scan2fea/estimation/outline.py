"""Where points lie to the outline of a section."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scan2fea.kernel.edges_distance import edges_distance
from scan2fea.kernel.sections import ROUND, drawn
from scan2fea.types import FloatArray, IntArray, Section


def edge_lengths(shape: Section) -> FloatArray:
    """(edges,) length of each edge of a section over all loops, m."""
    return np.concatenate([np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1) for loop in shape.loops])


def outline_distance(shape: Section, xy: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Signed distance (n,) of points (n, 2) to the outline, negative inside; the nearest edge (n,) over all loops, and how far along it (n,) m."""
    start = np.ascontiguousarray(np.concatenate(shape.loops), float)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    return edges_distance(start, way, np.ascontiguousarray(xy, float))


def inward(shape: Section) -> FloatArray:
    """(edges, 2) unit normals into the material: left of a loop that runs anticlockwise, and the material lies outside an opening."""
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    unit, turn = way / edge_lengths(shape)[:, None], []
    for k, loop in enumerate(shape.loops):
        x, y = loop.T
        anticlockwise = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) > 0
        turn += [1.0 if anticlockwise == (k == 0) else -1.0] * len(loop)
    return np.asarray(np.stack([-unit[:, 1], unit[:, 0]], axis=1) * np.array(turn)[:, None])


def first_across(at: FloatArray, direction: FloatArray, shape: Section, own: IntArray) -> tuple[IntArray, FloatArray]:
    """The edge that each ray from a place (m, 2) on its own edge (m,) meets first, and how far away, m: (m,), (m,)."""
    start = np.concatenate(shape.loops)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    across = direction[:, None, 0] * way[None, :, 1] - direction[:, None, 1] * way[None, :, 0]
    to = start[None] - at[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (to[..., 0] * way[None, :, 1] - to[..., 1] * way[None, :, 0]) / across
        part = (to[..., 0] * direction[:, None, 1] - to[..., 1] * direction[:, None, 0]) / across
    met = (across != 0) & (far > 0) & (part >= -1e-9) & (part <= 1 + 1e-9)
    met[np.arange(len(own)), own] = False
    far = np.where(met, far, np.inf)
    hit = far.argmin(axis=1)
    return hit, far[np.arange(len(hit)), hit]


def section_distance(family: str, values: Mapping[str, float], xy: FloatArray, *, filled: bool = False) -> FloatArray:
    """Signed distance (n,) of points (n, 2) to the section of a family, negative in its material. filled : without its opening; circles are exact."""
    if family in ROUND:
        r, radius = np.hypot(xy[:, 0], xy[:, 1]), values["d"] / 2
        return r - radius if filled or "t" not in values else np.maximum(r - radius, radius - values["t"] - r)
    shape = drawn(family, values)
    outer = Section(family=family, loops=shape.loops[:1], face_names=shape.face_names[:1])
    return outline_distance(outer if filled else shape, xy)[0]
