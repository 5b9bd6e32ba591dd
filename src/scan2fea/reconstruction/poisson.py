"""Screened Poisson: the surface of an indicator function whose gradient is the field of the normals, on an octree; the yardstick of the others.

Kazhdan, Hoppe, "Screened Poisson surface reconstruction", 2013: their own program, as COLMAP carries it (wheel `pycolmap`). It is given normals
only, not what was seen empty: two faces of a wall that are not some cells apart melt into one, and what no point saw becomes a balloon.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.colmap import colmap
from scan2fea.kernel.measures import volume
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import face_components, surface_topology
from scan2fea.reconstruction.closing import KEPT, checks_of
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions, visibility
from scan2fea.types import FloatArray, Scan, TriangleMesh

MARGIN = 1.1  # of what it is told to be there: the program's cube
ROOMS = (1.6, 1.7, 1.8, 1.9)  # of the part, tried in turn: its surface leaks through a nearer cube, and each has slivers, which may cross, elsewhere
CELLS_PER_WALL = 3.0  # fewer let the faces of a wall melt into one
COARSEST, FINEST = 2.0, 4.0  # cells per spacing: coarser ones round edges off, finer ones hold no points to speak of
DEEPEST = 11  # levels: 2048 cells along the part; memory grows fourfold with each
_HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex {n}\n{properties}end_header\n"
_FACE = np.dtype([("count", "<i4"), ("corner", "<i4", 3)])


def poisson(scan: Scan, options: VisibilityOptions = VisibilityOptions()) -> Reconstruction:
    """The surface round the denoised points of `visibility`, with their normals; judged by the same checks.

    Raises ReconstructionError; also where what the program gives is open, crosses itself or is no manifold.
    """
    first = visibility(scan, options)
    known = first.thickness_m[np.isfinite(first.thickness_m)]
    wall = float(np.median(known)) if len(known) else math.inf
    cell = float(np.clip(wall / CELLS_PER_WALL, first.spacing_m / FINEST, first.spacing_m / COARSEST))
    for room in ROOMS:
        mesh, depth = indicator_surface(first.points, first.normals, cell, room)
        mesh, n_dropped, n_parts = supported(mesh, first.points)
        found, crossing = surface_topology(mesh), len(self_intersections(mesh))
        if found.is_clean and crossing == 0:
            break
    else:
        raise ReconstructionError(
            f"Poisson's surface has {found.n_boundary_edges} open edges (it leaves its box where no points are), {found.n_nonmanifold_edges} of "
            f"three faces, {found.n_degenerate_faces} faces without area and {crossing} crossings, limit 0: use reconstruction.method = visibility"
        )
    how: dict[str, float | str] = {key: value for key, value in first.how.items() if key in KEPT}
    how |= {"method": "poisson", "depth": depth, "n_shells_dropped": n_dropped}
    return replace(first, mesh=mesh, checks=checks_of(scan, first, mesh, n_parts), how=how)


def indicator_surface(points: FloatArray, normals: FloatArray, cell_m: float, room: float = ROOMS[0]) -> tuple[TriangleMesh, int]:
    """The surface through points (n, 3) with outward normals (n, 3) on cells of at most `cell_m`, and the depth of the octree.

    room : side of the cube that is told to be there, in sides of the part. Raises ReconstructionError where there is none.
    """
    pycolmap = colmap()
    low, high = points.min(axis=0), points.max(axis=0)
    size, middle = float((high - low).max()), (low + high) / 2
    depth = min(DEEPEST, max(1, math.ceil(math.log2(MARGIN * room * size / cell_m))))
    how = pycolmap.PoissonMeshingOptions()
    how.depth, how.trim, how.color, how.num_threads = depth, 0.0, False, 1  # with threads of its own two runs differ in their last bits
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "points.ply", Path(folder) / "surface.ply"
        properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        rows = np.zeros((len(points) + 2, 6), "<f4")
        rows[:-2] = np.hstack([(points - middle) / size, normals])
        rows[-2:, :3] = [[-room / 2] * 3, [room / 2] * 3]  # without a normal they count for the cube alone
        given.write_bytes(_HEADER.format(n=len(rows), properties=properties).encode() + rows.tobytes())
        pycolmap.poisson_meshing(given, made, how)
        mesh = _read(made.read_bytes() if made.exists() else b"")
    return replace(mesh, vertices=mesh.vertices * size + middle), depth


def supported(mesh: TriangleMesh, points: FloatArray) -> tuple[TriangleMesh, int, int]:
    """The mesh without the shells that are nearest to no point, their number, and that of the outer shells that stay."""
    n, shell = face_components(mesh.faces)
    of_vertex = np.zeros(len(mesh.vertices), np.int64)
    of_vertex[mesh.faces] = shell[:, None]
    backed = np.zeros(n, bool)
    backed[of_vertex[k_nearest(mesh.vertices, 1, points)[1][:, 0]]] = True
    used, faces = np.unique(mesh.faces[backed[shell]], return_inverse=True)
    kept = replace(mesh, vertices=mesh.vertices[used], faces=faces.reshape(-1, 3))
    outer = sum(volume(replace(mesh, faces=mesh.faces[shell == k])) > 0 for k in np.flatnonzero(backed))
    return kept, int(n - backed.sum()), int(outer)


def _read(data: bytes) -> TriangleMesh:
    """What the program writes: vertices of three floats, triangles of their count and three corners. Raises ReconstructionError."""
    head, end, body = data.partition(b"end_header\n")
    counts = [int(line.split()[2]) for line in head.splitlines() if line.startswith(b"element")]
    there = bool(end) and len(counts) == 2 and min(counts) > 0
    require(there, ReconstructionError, "Poisson found no surface: use reconstruction.method = visibility")
    vertices = np.frombuffer(body, "<f4", 3 * counts[0]).reshape(-1, 3).astype(float)
    faces = np.frombuffer(body, _FACE, counts[1], offset=12 * counts[0])
    return TriangleMesh(vertices=vertices, faces=faces["corner"].astype(np.int64))
