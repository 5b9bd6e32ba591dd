"""Cracks between borders that were meant to meet: what exporters of patches leave that round each patch on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.topology import edge_table
from scan2fea.types import TriangleMesh

CRACK = 0.05  # of the shortest border edge at either vertex: a wider gap is a hole


def stitched(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices of borders that are each other's nearest across a crack made one, in the middle between them. No face goes."""
    table = edge_table(mesh.faces)
    rim = table.edges[table.count == 1]
    if not len(rim):
        return mesh
    n = len(mesh.vertices)
    length = np.linalg.norm(mesh.vertices[rim[:, 0]] - mesh.vertices[rim[:, 1]], axis=1)
    shortest = np.full(n, np.inf)
    for k in (0, 1):
        np.minimum.at(shortest, rim[:, k], length)
    own = np.unique(rim)
    points = mesh.vertices[own]
    distance, near = k_nearest(points, 2)
    itself = near[:, 0] == np.arange(len(own))
    other, gap = np.where(itself, near[:, 1], near[:, 0]), np.where(itself, distance[:, 1], distance[:, 0])
    mutual = other[other] == np.arange(len(own))
    fits = mutual & (gap <= CRACK * np.minimum(shortest[own], shortest[own[other]])) & (np.arange(len(own)) < other)
    first, second = own[fits], own[other[fits]]
    if not len(first):
        return mesh
    vertices, packed = mesh.vertices.copy(), np.arange(n)
    vertices[first] = 0.5 * (vertices[first] + vertices[second])
    vertices[second] = vertices[first]
    packed[second] = first
    return replace(mesh, vertices=vertices, faces=packed[mesh.faces])
