"""What goes wrong with real parts: sag, twist, a missing corner, a cut, a dent. Each takes a closed mesh and gives a closed mesh.

Directions are those of the shape's own frame; members run along z.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.construction import Carved, Change, Dented, Sagged, Twisted, around, bent
from scan2fea.kernel.measures import face_normals
from scan2fea.simulation.carving import carved, sliced
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

AXES = {"+x": (1.0, 0, 0), "-x": (-1.0, 0, 0), "+y": (0, 1.0, 0), "-y": (0, -1.0, 0), "+z": (0, 0, 1.0), "-z": (0, 0, -1.0)}
_MOST_ROUNDS = 40  # each halves the longest edges near a dent


@dataclass(frozen=True, kw_only=True)
class Defect:
    """lengths, numbers, words, points : keys of the scene file, in metres (points: three lengths).   make : mesh, values, chord -> mesh.

    tell : the same in the words of kernel.construction: mesh before it, values -> change.   is_curved : it makes curved surfaces of plane ones.
    """

    lengths: tuple[str, ...] = ()
    numbers: tuple[str, ...] = ()
    words: Mapping[str, tuple[str, ...]]
    points: tuple[str, ...] = ()
    make: Callable[[TriangleMesh, Mapping[str, float], Mapping[str, str], Mapping[str, FloatArray], float], TriangleMesh]
    tell: Callable[[TriangleMesh, Mapping[str, float], Mapping[str, str], Mapping[str, FloatArray]], Change]
    is_curved: bool = True


def sagged(mesh: TriangleMesh, depth: float, direction: str, chord_m: float) -> TriangleMesh:
    """The middle of the length (z) moved by `depth`, the ends kept, a parabola between.

    Slabs between planes across z are sheared, so plane faces along the member stay plane in each, and the volume is kept exactly. The slabs are
    so many that the true parabola is within the chord tolerance.
    """
    low, high = _along_z(mesh)
    n = max(2, math.ceil(math.sqrt(abs(depth) / chord_m))) if depth else 1
    cut = sliced(mesh, (0, 0, 1), np.linspace(low, high, n + 1)[1:-1].tolist())
    return TriangleMesh(vertices=bent(cut.vertices, _sag(mesh, depth, direction)), faces=cut.faces)


def _sag(mesh: TriangleMesh, depth: float, direction: str) -> Sagged:
    low, high = _along_z(mesh)
    return Sagged(direction=np.array(AXES[direction]), depth_m=depth, low=low, high=high)


def twisted(mesh: TriangleMesh, angle_rad: float, chord_m: float) -> TriangleMesh:
    """Turned about the z axis, from nothing at the low end to `angle_rad` at the high one.

    A flat strip of width w between two planes becomes a saddle, which two triangles miss by w / 4 times the turn between the planes; the planes
    are so many that this, for the whole width of the section, keeps the chord tolerance.
    """
    low, high = _along_z(mesh)
    width = 2 * float(np.linalg.norm(mesh.vertices[:, :2], axis=1).max())
    n = max(2, math.ceil(abs(angle_rad) * width / (4 * chord_m))) if angle_rad else 1
    cut = sliced(mesh, (0, 0, 1), np.linspace(low, high, n + 1)[1:-1].tolist())
    return TriangleMesh(vertices=bent(cut.vertices, _twist(mesh, angle_rad)), faces=cut.faces)


def _twist(mesh: TriangleMesh, angle_rad: float) -> Twisted:
    low, high = _along_z(mesh)
    return Twisted(angle_rad=angle_rad, low=low, high=high)


def without_corner(mesh: TriangleMesh, corner: str, size_m: float) -> TriangleMesh:
    """Less the corner of its box that `corner` names ("+-+": high x, low y, high z): beyond the plane `size_m` along each axis from it.

    Of a box this takes size^3 / 6. Raises InputError where nothing is there to be cut.
    """
    return _carve(mesh, _corner(mesh, corner, size_m))


def _corner(mesh: TriangleMesh, corner: str, size_m: float) -> Carved:
    sign = np.array([1.0 if c == "+" else -1.0 for c in corner])
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    at = np.where(sign > 0, high, low)
    return Carved(normals=sign[None], offsets=np.array([float(sign @ at - size_m)]))


def _carve(mesh: TriangleMesh, change: Carved) -> TriangleMesh:
    return carved(mesh, [(normal, float(offset)) for normal, offset in zip(change.normals, change.offsets, strict=True)])


def slotted(mesh: TriangleMesh, at_m: float, width_m: float, depth_m: float, side: str) -> TriangleMesh:
    """Less a straight saw cut across z, `width_m` wide about z = at, as deep as `depth_m` from the side named.

    Raises InputError where nothing is there to be cut.
    """
    return _carve(mesh, _slot(mesh, at_m, width_m, depth_m, side))


def _slot(mesh: TriangleMesh, at_m: float, width_m: float, depth_m: float, side: str) -> Carved:
    normal = np.array(AXES[side])
    top = float((mesh.vertices @ normal).max())
    offsets = np.array([at_m - width_m / 2, -(at_m + width_m / 2), top - depth_m])
    return Carved(normals=np.array([[0.0, 0, 1], [0, 0, -1], normal]), offsets=offsets)


def dented(mesh: TriangleMesh, at: FloatArray, direction: str, radius_m: float, depth_m: float, reach_m: float, chord_m: float) -> TriangleMesh:
    """Pushed in around the line through `at` along `direction`: by depth (1 - r^2 / radius^2)^2 at the distance r from the line.

    Only what lies within `reach_m` of `at` along the line gives way: the wall, not what is behind it. Where one flat face gives way the solid
    loses pi radius^2 depth / 3; where both faces of a wall do, it keeps its volume. Faces are divided until the chord tolerance holds.
    """
    axis = np.array(AXES[direction])
    edge = radius_m * math.sqrt(chord_m / depth_m)
    fine = _divided(mesh, at, axis, radius_m, reach_m, edge)
    share, along = around(fine.vertices, Dented(at=at, axis=axis, radius_m=radius_m, depth_m=depth_m, reach_m=reach_m))
    push = np.where((share > 0) & (np.abs(along) <= reach_m), depth_m * np.maximum(share, 0) ** 2, 0.0)
    require(bool((push > 0).any()), InputError, f"the dent at {at.tolist()} m meets no surface: move it or raise `reach`")
    pushed = TriangleMesh(vertices=fine.vertices + push[:, None] * axis, faces=fine.faces)
    turned = np.einsum("ij,ij->i", face_normals(fine), face_normals(pushed)) < 0
    says = f"the dent at {np.asarray(at).tolist()} m folds a face where its reach ends: raise `reach`, or move it off that face"
    require(not turned.any(), InputError, says)
    return pushed


def _divided(mesh: TriangleMesh, at: FloatArray, axis: FloatArray, radius_m: float, reach_m: float, edge_m: float) -> TriangleMesh:
    """Edges longer than `edge_m` that come near the dent are halved until there are none; faces that share a halved edge are cut along."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(_MOST_ROUNDS):
        pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, of_edge = np.unique(pairs, axis=0, return_inverse=True)
        a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
        length = np.linalg.norm(b - a, axis=1)
        near = _near(a, b, at, axis, radius_m, reach_m)
        by_face = of_edge.reshape(-1, 3)
        # the dent may lie in the middle of a face, far from its edges
        pierced = np.flatnonzero(_pierced(vertices[faces], at, axis, reach_m + radius_m))
        near[by_face[pierced, np.argmax(length[by_face[pierced]], axis=1)]] = True
        halve = near & (length > edge_m)
        if not halve.any():
            return TriangleMesh(vertices=vertices, faces=faces)
        middle = np.full(len(edges), -1, np.int64)
        middle[halve] = len(vertices) + np.arange(int(halve.sum()))
        vertices = np.concatenate([vertices, (a[halve] + b[halve]) / 2])
        faces = _with_middles(faces, middle[by_face], vertices)
    return TriangleMesh(vertices=vertices, faces=faces)


def _near(a: FloatArray, b: FloatArray, at: FloatArray, axis: FloatArray, radius_m: float, reach_m: float) -> BoolArray:
    """Edges whose nearest point to the line of the dent lies within its radius, at a height that gives way."""
    p, d = a - at, b - a
    p_across, d_across = p - (p @ axis)[:, None] * axis, d - (d @ axis)[:, None] * axis
    long = (d_across**2).sum(axis=1)
    t = np.clip(-(p_across * d_across).sum(axis=1) / np.where(long > 0, long, 1.0), 0, 1)
    nearest = p + t[:, None] * d
    height = nearest @ axis
    inside = ((nearest - height[:, None] * axis) ** 2).sum(axis=1) < radius_m**2
    return np.asarray(inside & (np.abs(height) <= reach_m + radius_m))


def _pierced(tri: FloatArray, at: FloatArray, axis: FloatArray, reach_m: float) -> BoolArray:
    """(m,) triangles (m, 3, 3) that the line through `at` along `axis` meets within the reach."""
    away = tri - at
    height = away @ axis
    flat = away - height[..., None] * axis
    turn = np.stack([np.cross(flat[:, k - 1], flat[:, k]) @ axis for k in range(3)], axis=1)  # twice the area opposite corner k + 1
    whole = turn.sum(axis=1)
    share = np.divide(turn, whole[:, None], out=np.full_like(turn, -1.0), where=(whole != 0)[:, None])
    at_line = (share * np.roll(height, -1, axis=1)).sum(axis=1)
    return np.asarray((share >= 0).all(axis=1) & (np.abs(at_line) <= reach_m))


def _with_middles(faces: IntArray, middle: IntArray, vertices: FloatArray) -> IntArray:
    """Triangles with 0 to 3 middles of their edges put in: middle[:, k] lies on the edge from corner k to k + 1, -1 for none."""
    count = (middle >= 0).sum(axis=1)
    out = [faces[count == 0]]
    for k in range(3):  # one middle, on edge k
        f, m = (np.roll(x[(count == 1) & (middle[:, k] >= 0)], -k, axis=1) for x in (faces, middle))
        out += [np.stack([f[:, 0], m[:, 0], f[:, 2]], 1), np.stack([m[:, 0], f[:, 1], f[:, 2]], 1)]
        f, m = (np.roll(x[(count == 2) & (middle[:, k] < 0)], -k, axis=1) for x in (faces, middle))  # two: all but edge k
        a, b, c, p, q = f[:, 0], f[:, 1], f[:, 2], m[:, 1], m[:, 2]  # p on bc, q on ca
        out.append(np.stack([p, c, q], 1))
        short = np.linalg.norm(vertices[a] - vertices[p], axis=1) < np.linalg.norm(vertices[b] - vertices[q], axis=1)
        first = np.where(short[:, None], np.stack([a, b, p], 1), np.stack([a, b, q], 1))
        second = np.where(short[:, None], np.stack([a, p, q], 1), np.stack([b, p, q], 1))
        out += [first, second]
    f, m = faces[count == 3], middle[count == 3]
    out += [np.stack([f[:, k], m[:, k], m[:, k - 1]], 1) for k in range(3)] + [m]
    return np.concatenate(out).astype(np.int64)


def _along_z(mesh: TriangleMesh) -> tuple[float, float]:
    return float(mesh.vertices[:, 2].min()), float(mesh.vertices[:, 2].max())


_CORNERS = tuple(a + b + c for a in "+-" for b in "+-" for c in "+-")
DEFECTS: Mapping[str, Defect] = {
    "sag": Defect(
        lengths=("depth",),
        words={"direction": ("+x", "-x", "+y", "-y")},
        make=lambda m, v, w, p, c: sagged(m, v["depth"], w["direction"], c),
        tell=lambda m, v, w, p: _sag(m, v["depth"], w["direction"]),
    ),
    "twist": Defect(
        numbers=("angle_deg",),
        words={},
        make=lambda m, v, w, p, c: twisted(m, math.radians(v["angle_deg"]), c),
        tell=lambda m, v, w, p: _twist(m, math.radians(v["angle_deg"])),
    ),
    "missing_corner": Defect(
        lengths=("size",),
        words={"corner": _CORNERS},
        make=lambda m, v, w, p, c: without_corner(m, w["corner"], v["size"]),
        tell=lambda m, v, w, p: _corner(m, w["corner"], v["size"]),
        is_curved=False,
    ),
    "cut": Defect(
        lengths=("at", "width", "depth"),
        words={"side": ("+x", "-x", "+y", "-y")},
        make=lambda m, v, w, p, c: slotted(m, v["at"], v["width"], v["depth"], w["side"]),
        tell=lambda m, v, w, p: _slot(m, v["at"], v["width"], v["depth"], w["side"]),
        is_curved=False,
    ),
    "dent": Defect(
        lengths=("radius", "depth", "reach"),
        words={"direction": tuple(AXES)},
        points=("at",),
        make=lambda m, v, w, p, c: dented(m, p["at"], w["direction"], v["radius"], v["depth"], v["reach"], c),
        tell=lambda m, v, w, p: Dented(
            at=np.asarray(p["at"], float), axis=np.array(AXES[w["direction"]]), radius_m=v["radius"], depth_m=v["depth"], reach_m=v["reach"]
        ),
    ),
}
