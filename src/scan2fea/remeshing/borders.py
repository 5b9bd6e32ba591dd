"""Labels whose borders are simple: around every vertex each label holds one run of faces, so that no border passes a vertex twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.topology import half_edges
from scan2fea.remeshing.planes import Labelled, Neighbours, Scale
from scan2fea.types import IntArray, TriangleMesh

ROUNDS = 20


def outgoing(mesh: TriangleMesh) -> IntArray:
    """(n,) one half-edge that starts at each vertex."""
    flat = mesh.faces.ravel()
    out = np.zeros(len(mesh.vertices), np.int64)
    out[flat[::-1]] = np.arange(len(flat))[::-1]
    return out


def fan(v: int, out: IntArray, twin: IntArray) -> list[int]:
    """The half-edges that start at v, in order round it (clockwise seen from outside)."""
    ring, h = [], int(out[v])
    while True:
        ring.append(h)
        h = int(twin[h // 3 * 3 + (h + 2) % 3])
        if h == ring[0]:
            return ring


def runs(ring: list[int], label: IntArray) -> list[tuple[int, list[int]]]:
    """(label, faces) of the runs of equally labelled faces round a vertex."""
    names = [int(label[h // 3]) for h in ring]
    start = next((k for k in range(len(ring)) if names[k] != names[k - 1]), 0)
    out: list[tuple[int, list[int]]] = []
    for k in range(start, start + len(ring)):
        name, face = names[k % len(ring)], ring[k % len(ring)] // 3
        if out and out[-1][0] == name:
            out[-1][1].append(face)
        else:
            out.append((name, [face]))
    return out


def pinched_vertices(mesh: TriangleMesh, label: IntArray, twin: IntArray) -> IntArray:
    """Vertices round which some label holds two runs or more: more borders meet there than labels."""
    ends = half_edges(mesh.faces)
    face = np.arange(len(twin)) // 3
    border = label[face] != label[twin // 3]
    n_borders = np.bincount(ends[border, 0], minlength=len(mesh.vertices))
    busy = np.flatnonzero((n_borders > 2)[mesh.faces.ravel()])  # corners of faces, few
    n_names = int(label.max(initial=0)) + 2
    key = np.unique(mesh.faces.ravel()[busy] * n_names + label[busy // 3] + 1)
    n_labels = np.bincount(key // n_names, minlength=len(mesh.vertices))
    return np.flatnonzero((n_borders > 2) & (n_borders > n_labels))


def unpinched(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale, *, may_join: bool = True) -> Labelled:
    """The labels with every pinch of a plane resolved: the run that parts it from itself joins it if it lies near enough to the plane, else
    the smaller of its own runs becomes what lies beside it.
    """
    label = labelled.label.copy()
    twin, out = neighbours.table.twin, outgoing(mesh)
    for attempt in range(ROUNDS):
        pinches = pinched_vertices(mesh, label, twin)
        changed = False
        for v in pinches:
            around = runs(fan(int(v), out, twin), label)
            names = [name for name, _ in around]
            again = next((name for name in names if name >= 0 and names.count(name) > 1), None)
            if again is None:
                again = next((name for name in names if names.count(name) > 1), None)
                if again is None:
                    continue
            changed |= _resolve(mesh, neighbours, labelled, label, around, again, scale, may_join=may_join and attempt < ROUNDS // 2)
        if not changed:
            break
    return replace(labelled, label=label)


def _resolve(
    mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, label: IntArray, around: list[tuple[int, list[int]]], again: int, scale: Scale,
    *, may_join: bool,
) -> bool:  # fmt: skip
    """Relabel one run of the pinch of label `again`; `label` is changed."""
    others = [faces for name, faces in around if name != again]
    own = [k for k, (name, _) in enumerate(around) if name == again]
    if again >= 0 and may_join:
        # the runs between two own runs; joining one of two sides suffices
        gap = [float(np.abs(mesh.vertices[mesh.faces[faces]] @ labelled.normal[again] - labelled.offset[again]).max()) for faces in others]
        best = int(np.argmin(gap))
        if gap[best] <= scale.reach_m:
            label[others[best]] = again
            return True
    smallest = min(own, key=lambda k: (float(neighbours.areas[around[k][1]].sum()), k))
    before, after = around[smallest - 1][0], around[(smallest + 1) % len(around)][0]
    near = []
    for name in (before, after):
        corners = mesh.vertices[mesh.faces[around[smallest][1]]]
        height = np.abs(corners @ labelled.normal[name] - labelled.offset[name]).max() if name >= 0 else scale.reach_m
        near.append((float(height), name))
    height, name = min(near)
    label[around[smallest][1]] = name if height <= scale.reach_m else -1
    return True
