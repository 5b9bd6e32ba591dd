"""Objects of known kinds as a scanner sees them, for teaching and testing: sizes, stand, noise, gaps and what hides them follow a seed.

Share seen: of the points that eight stations all round see, those that are left after stations are missing or something stands in the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.types import BoolArray, FloatArray, TriangleMesh, Value

OBJECT_KINDS = ("plate", "I", "L", "C", "T", "box", "pipe", "free form", "clutter")
LEAST_SEEN = 0.5
_VIEWS = 8
_POINTS = (600, 7000)
_NOISE = (1e-3, 5e-2)  # of the second largest side
_CANDIDATES = 10_000
_CHORD = 0.01
_FOREIGN = 0.02
_SCATTER = 0.4  # of the clutter: leaves, sparks; the rest are heaps of several things


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenObject(Value):
    """points : (n, 3).   kind : of OBJECT_KINDS.   noise : standard deviation over the second largest side.   seen : share, 0.5 .. 1."""

    points: FloatArray
    kind: str
    noise: float
    seen: float


def objects_of_kind(kind: str, seed: int, n_views: int = 3) -> list[SeenObject]:
    """One object, seen `n_views` times under other conditions."""
    rng = np.random.default_rng([seed, OBJECT_KINDS.index(kind), 77])
    if kind == "clutter" and rng.random() < _SCATTER:
        return [_scatter(rng) for _ in range(n_views)]
    mesh = _mesh(kind, rng)
    mesh = posed(mesh, rigid(quaternion_to_matrix(rng.standard_normal(4)), rng.uniform(-5, 5, 3)))
    points, _ = sample_surface(mesh, _CANDIDATES, int(rng.integers(2**31)))
    stations, seen = _views(mesh, points, rng)
    return [_look(kind, points, stations, seen, mesh, rng) for _ in range(n_views)]


def _views(mesh: TriangleMesh, points: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    """Eight stations all round (8, 3) and which of the points (n,) each sees (8, n)."""
    middle, reach = mesh.vertices.mean(axis=0), float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    turned = corner @ quaternion_to_matrix(rng.standard_normal(4)).T / np.sqrt(3.0)
    stations = middle + turned * reach * rng.uniform(1.0, 4.0, (_VIEWS, 1))
    target, seen = scene_of(mesh), np.zeros((_VIEWS, len(points)), bool)
    for k, station in enumerate(stations):
        way = points - station
        t, _ = first_hits(target, np.broadcast_to(station, points.shape), way)
        seen[k] = t >= 1 - 1e-6
    return stations, seen


def _look(
    kind: str, points: FloatArray, stations: FloatArray, seen: BoolArray, mesh: TriangleMesh, rng: np.random.Generator
) -> SeenObject:
    """The object from some of its stations, partly hidden, thinned, with noise along the rays and a few foreign points."""
    every = seen.any(axis=0)
    rows, share = np.flatnonzero(every), 1.0
    for _ in range(8):  # what hides too much is drawn again
        chosen = rng.permutation(_VIEWS)[: int(rng.integers(1, _VIEWS + 1))]
        mine = seen[chosen].any(axis=0)
        mine &= ~_hidden(points, mesh, rng)
        if mine.sum() >= max(LEAST_SEEN * every.sum(), 100):
            rows, share = np.flatnonzero(mine), float(mine.sum() / every.sum())
            break
    n = int(np.exp(rng.uniform(*np.log(_POINTS))))
    rows = rng.permutation(rows)[:n]
    out = points[rows]
    size = _second_side(mesh.vertices)
    noise = float(np.exp(rng.uniform(*np.log(_NOISE))))
    station = stations[int(rng.integers(_VIEWS))]
    away = out - station
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    out = out + noise * size * rng.standard_normal((len(out), 1)) * away + 0.2 * noise * size * rng.standard_normal(out.shape)
    n_foreign = int(rng.uniform(0, _FOREIGN) * len(out))
    low, high = out.min(axis=0), out.max(axis=0)
    foreign = low + (high - low) * rng.random((n_foreign, 3))
    return SeenObject(points=np.concatenate([out, foreign]), kind=kind, noise=noise, seen=share)


def _hidden(points: FloatArray, mesh: TriangleMesh, rng: np.random.Generator) -> BoolArray:
    """(n,) points behind something: nothing, all beyond a plane, a ball, or a slab across the object, each as often."""
    way = int(rng.integers(4))
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    along = points @ direction
    if way == 1:
        return np.asarray(along > np.quantile(along, rng.uniform(0.5, 1.0)))
    if way == 2:
        distance = np.linalg.norm(points - points[int(rng.integers(len(points)))], axis=1)
        return np.asarray(distance < np.quantile(distance, rng.uniform(0.0, 0.45)))
    if way == 3:
        start = rng.uniform(0.1, 0.6)
        low, high = np.quantile(along, [start, start + rng.uniform(0.0, 0.4)])
        return np.asarray((along > low) & (along < high))
    return np.zeros(len(points), bool)


def _second_side(vertices: FloatArray) -> float:
    local = vertices - vertices.mean(axis=0)
    return float(np.sort(np.ptp(local @ np.linalg.eigh(local.T @ local)[1], axis=0))[1])


def _length(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _mesh(kind: str, rng: np.random.Generator) -> TriangleMesh:
    """A solid of the kind; one of its larger sides is 1 m, as the network sees proportions only."""
    u = rng.uniform
    if kind == "clutter":
        return _heap(rng)
    if kind == "plate":
        return _built("plate", b=1.0, t=u(0.01, 0.12), length=_length(rng, 0.5, 8.0))
    if kind in ("pipe", "box", "free form"):
        return _round_or_box(kind, rng)
    length = _length(rng, 1.0, 25.0)
    if kind == "L":
        a, b, t = 1.0, u(0.5, 1.0), u(0.04, 0.16)
        if rng.random() < 0.25:
            return _built("bracket", a=a, b=b, t=t, width=u(0.5, 2.0), holes=())
        return _built("L", a=a, b=b, t=t, length=length, **_fillet(rng, 0.8 * min(t, b - t)))
    h, b = (1.0, u(0.35, 1.05)) if kind == "I" else (1.0, u(0.25, 0.6)) if kind == "C" else (u(0.45, 1.1), 1.0)
    tw = u(0.015, 0.07) if kind != "T" else u(0.03, 0.12)
    tf = min(tw * u(1.0, 2.2), 0.14)
    return _built(kind, h=h, b=b, tw=tw, tf=tf, length=length, **_fillet(rng, 0.1 * min(h, b)))


def _round_or_box(kind: str, rng: np.random.Generator) -> TriangleMesh:
    u = rng.uniform
    if kind == "pipe":
        if rng.random() < 0.3:
            return _built(str(rng.choice(["round", "cylinder"])), d=1.0, length=_length(rng, 1.0, 20.0))
        return _built("CHS", d=1.0, t=u(0.02, 0.15), length=_length(rng, 1.0, 25.0))
    if kind == "box":
        if rng.random() < 0.5:
            return _built("box", x=1.0, y=u(0.3, 1.0), z=_length(rng, 0.3, 6.0))
        return _built("RHS", h=1.0, b=u(0.4, 1.0), t=u(0.02, 0.08), length=_length(rng, 1.5, 25.0))
    way = int(rng.integers(4))
    if way == 0:
        return _built("blob", d=1.0, wave=u(0.1, 0.45), shape_seed=int(rng.integers(10_000)))
    if way == 1:
        return _built("sphere", d=1.0)
    if way == 2:
        return _built("tank", d=1.0, height=u(0.7, 1.6), t=u(0.02, 0.08))
    return _built("vessel", d=1.0, length=u(0.8, 1.4))


def _fillet(rng: np.random.Generator, most: float) -> dict[str, float]:
    return {"fillet": most * rng.uniform(0.3, 1.0)} if rng.random() < 0.5 else {}


def _built(kind: str, **values: object) -> TriangleMesh:
    return KINDS[kind].build(values, _CHORD).mesh


def _heap(rng: np.random.Generator) -> TriangleMesh:
    """Three to six different things across each other, or a table."""
    if rng.random() < 0.25:
        return _built("table", x=1.0, y=rng.uniform(0.5, 1.0), height=rng.uniform(0.5, 0.9), top=0.04, leg=0.06, inset=0.05)
    meshes = []
    for _ in range(int(rng.integers(3, 7))):
        kind = str(rng.choice(["box", "round", "plate", "L", "sphere"]))
        sizes: dict[str, dict[str, object]] = {
            "box": {"x": rng.uniform(0.2, 0.6), "y": rng.uniform(0.2, 0.6), "z": rng.uniform(0.2, 0.6)},
            "round": {"d": rng.uniform(0.05, 0.3), "length": rng.uniform(0.4, 1.0)},
            "plate": {"b": rng.uniform(0.3, 0.7), "t": 0.03, "length": rng.uniform(0.4, 0.9)},
            "L": {"a": 0.25, "b": 0.2, "t": 0.03, "length": rng.uniform(0.4, 1.0)},
            "sphere": {"d": rng.uniform(0.2, 0.5)},
        }
        T = rigid(quaternion_to_matrix(rng.standard_normal(4)), rng.uniform(-0.3, 0.3, 3))
        meshes.append(posed(_built(kind, **sizes[kind]), T))
    first = np.cumsum([0] + [len(m.vertices) for m in meshes])
    faces = np.concatenate([m.faces + f for m, f in zip(meshes, first, strict=False)])
    return TriangleMesh(vertices=np.concatenate([m.vertices for m in meshes]), faces=faces)


def _scatter(rng: np.random.Generator) -> SeenObject:
    """Points that lie on no surface: clouds of different spread around a few places."""
    n = int(np.exp(rng.uniform(*np.log(_POINTS))))
    middles = rng.uniform(-0.5, 0.5, (int(rng.integers(1, 8)), 3)) * rng.uniform(0.3, 1.0, 3)
    at = rng.integers(len(middles), size=n)
    spread = rng.uniform(0.05, 0.35, len(middles))[at]
    return SeenObject(points=middles[at] + spread[:, None] * rng.standard_normal((n, 3)), kind="clutter", noise=0.0, seen=1.0)

