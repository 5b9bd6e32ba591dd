"""The topology of a B-Rep of plane faces: vertices, straight edges shared by two faces, wires of edges.

Vertices and edges are shared by construction, so that no sewing tolerance is needed (a tolerance closes a shell and leaves it invalid).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import CadError, require
from scan2fea.kernel.planar_regions import PlanarRegions
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaneFace:
    """One face. region : id, -1 for a facet.   facet : its triangle, -1 for a region.   wires : closed loops of vertices, the outer one first."""

    region: int
    facet: int
    normal: FloatArray
    point: FloatArray
    area_m2: float
    wires: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Patchwork:
    """Faces in the order of the STEP file (regions by id, then facets by triangle). vertices : (n, 3) metres, shared by all."""

    vertices: FloatArray
    faces: tuple[PlaneFace, ...]


def patchwork(mesh: TriangleMesh, regions: PlanarRegions, limit: float) -> Patchwork:
    """Faces with their wires; border vertices inside a straight border of the same two faces are left out (`limit`: metres off the line).

    Raises CadError where a face has no usable border.
    """
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices)
    group = _group(regions)
    loops = _loops(faces, group, len(vertices))
    keep = _corners(vertices, [w for face in loops for w in face], limit)
    normals, areas = _facet_planes(vertices, faces)
    order = np.unique(group, return_index=True)[1]
    area = np.bincount(group, weights=areas)
    built: list[PlaneFace] = []
    for number, wires in enumerate(loops):
        first = int(order[number])
        region = int(regions.label[first])
        slot = int(np.searchsorted(regions.ids, region))
        normal = regions.normal[slot] if region >= 0 else normals[first]
        point = regions.point[slot] if region >= 0 else vertices[faces[first, 0]]
        kept = tuple(tuple(v for v in wire if keep[v]) for wire in wires)
        ordered = _outer_first(vertices, kept, normal) if len(kept) > 1 else kept
        facet = -1 if region >= 0 else first
        built.append(PlaneFace(region=region, facet=facet, normal=normal, point=point, area_m2=float(area[number]), wires=ordered))
    return Patchwork(vertices=vertices, faces=tuple(built))


def _group(regions: PlanarRegions) -> IntArray:
    """(m,) face number of each triangle: regions first, in order of id, then the triangles that stand alone."""
    alone = regions.label < 0
    group = np.searchsorted(regions.ids, regions.label)
    group[alone] = len(regions.ids) + np.arange(int(alone.sum()))
    return group.astype(np.int64)


def _facet_planes(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], length / 2


def _loops(faces: IntArray, group: IntArray, n_vertices: int) -> list[list[list[int]]]:
    """Per face its border loops, along the half-edges of its triangles (counter-clockwise outside, clockwise around holes)."""
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(group, 3)
    key, reverse = tail * n_vertices + head, head * n_vertices + tail
    order = np.argsort(key)
    twin = order[np.searchsorted(key, reverse, sorter=order)]
    border = np.flatnonzero(owner != owner[twin])
    follow: list[dict[int, int]] = [{} for _ in range(int(group.max()) + 1)]
    for g, u, v in zip(owner[border].tolist(), tail[border].tolist(), head[border].tolist(), strict=True):
        follow[g][u] = v
    loops = []
    for number, step in enumerate(follow):
        require(step, CadError, f"face {number} of the solid has no border: one plane cannot close a solid; the surface is not a solid's")
        wires = []
        while step:
            start = next(iter(step))
            wire, at = [], start
            while at in step:
                wire.append(at)
                at = step.pop(at)
            wires.append(wire)
        loops.append(wires)
    return loops


def _corners(vertices: FloatArray, wires: list[list[int]], limit: float) -> BoolArray:
    """(n,) vertices that stay: all but those inside a straight border between the same two faces."""
    degree = np.zeros(len(vertices), np.int64)
    for wire in wires:
        degree[wire] += 1  # number of faces that meet there
    keep = degree != 2
    for wire in wires:
        for chain in _chains(wire, keep):
            if not _is_straight(vertices, chain, limit):
                keep[chain] = True
    for wire in wires:  # a sliver facet whose three corners lie on one line still needs them
        if np.count_nonzero(keep[wire]) < 3:
            keep[wire] = True
    return np.asarray(keep)


def _chains(wire: list[int], keep: BoolArray) -> list[list[int]]:
    """Runs of the wire from one kept vertex to the next that pass droppable ones; the whole wire where none is kept."""
    corners = [i for i, v in enumerate(wire) if keep[v]]
    if not corners:
        return [[*wire, wire[0]]]
    ring = [*wire[corners[0] :], *wire[: corners[0] + 1]]
    stops = [i for i, v in enumerate(ring) if keep[v]]
    if stops[-1] != len(ring) - 1:
        stops.append(len(ring) - 1)
    return [ring[a : b + 1] for a, b in itertools.pairwise(stops) if b - a > 1]


def _is_straight(vertices: FloatArray, chain: list[int], limit: float) -> bool:
    p = vertices[chain]
    along = p[-1] - p[0]
    length = float(np.linalg.norm(along))
    if length <= limit:
        return False
    at = (p - p[0]) @ along / length
    off = np.linalg.norm(p - p[0] - at[:, None] * along / length, axis=1)
    return bool(off.max() <= limit and (np.diff(at) > 0).all())


def _outer_first(vertices: FloatArray, wires: tuple[tuple[int, ...], ...], normal: FloatArray) -> tuple[tuple[int, ...], ...]:
    """The wire that runs counter-clockwise first. Raises CadError where there is not exactly one."""
    signed = []
    for wire in wires:
        p = vertices[list(wire)] - vertices[wire[0]]
        signed.append(float(np.cross(p, np.roll(p, -1, axis=0)).sum(0) @ normal) / 2)
    outer = [i for i, s in enumerate(signed) if s > 0]
    require(len(outer) == 1, CadError, f"a plane face has {len(outer)} outer borders instead of one: its region crosses itself; repair the surface")
    return (wires[outer[0]], *(w for i, w in enumerate(wires) if i != outer[0]))
