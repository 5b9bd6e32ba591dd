"""How large the elements should be, from the part itself: its walls, its volume and area, and what a solver can carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import area as surface_area
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.thickness import wall_thickness
from scan2fea.types import TriangleMesh

WALLS_PER_EDGE = 2.0  # TET10 one element deep is within 0.5 % in bending (measured on the L-beam: edges of 2 and 4 walls, 0.1 and 0.3 %)
MAX_WALLS_PER_EDGE = 6.0  # flat tets: smallest dihedral about 50 deg over this (measured 12 to 14 at 4); the limit of verification is 5
COMPACT_TETS = 15_000  # a compact part gets this many: more says no more about it, and compact meshes fill up in the solver


THIN_NODES_PER_TET = 2.05  # TET10, one layer: n corners, 3 n tets, 5 n edges; measured 2.04
COMPACT_NODES_PER_TET = 1.6


@dataclass(frozen=True, kw_only=True)
class Size:
    """edge_m, the largest that walls allow whatever the budget, and the wall thickness both came from."""

    edge_m: float
    max_edge_m: float
    wall_m: float


def edge_for(volume_m3: float, area_m2: float, max_tets: float, max_nodes: float) -> float:
    """The smallest edge at which a body stays within tets and TET10 nodes.

    Tets: the volume over that of a regular tet, h^3 / 8.49; or for walls thinner than h, 3 for each triangle of their middle surface:
    area / 2 over sqrt(3) / 4 h^2, times 3, is 3.46 area / h^2; gmsh's meshes of an L-beam at 2 to 4 walls have 3.8 to 4.1.
    """
    compact = 8.49 * volume_m3 / min(max_tets, max_nodes / COMPACT_NODES_PER_TET)
    thin = 4.2 * area_m2 / min(max_tets, max_nodes / THIN_NODES_PER_TET)
    return float(max(compact ** (1 / 3), thin**0.5))


def element_size(mesh: TriangleMesh, max_tets: float, max_nodes: float, seed: int) -> Size:
    """Two wall thicknesses, finer for compact parts, coarser where the budget would not do."""
    volume, area = enclosed_volume(mesh), surface_area(mesh)
    walls = wall_thickness(mesh, seed)
    wall = float(np.median(walls)) if len(walls) else 2 * volume / area
    wanted = min(WALLS_PER_EDGE * wall, edge_for(volume, area, COMPACT_TETS, np.inf))
    most = MAX_WALLS_PER_EDGE * wall
    return Size(edge_m=min(max(wanted, edge_for(volume, area, max_tets, max_nodes)), most), max_edge_m=most, wall_m=wall)
