"""Advancing front: from the facet with the smallest empty ball outward, always the most plausible Delaunay facet next.

Cohen-Steiner, Da, "A greedy Delaunay-based surface reconstruction algorithm", The Visual Computer 20, 2004. On a front edge the candidate is the
facet with the smallest empty ball; one that turns by less than `wedge` counts by that radius, any other by its angle, after all of those. Outside the
wedge a candidate whose ball is more than `radius_ratio` times that of the triangle behind the edge is refused, which leaves borders. The surface is a
manifold with borders; `closing` makes it the boundary of a solid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.delaunay import Tetrahedralisation
from scan2fea.options import option
from scan2fea.reconstruction.closing import Pieces, closed_reconstruction
from scan2fea.reconstruction.front_candidates import facet_radii
from scan2fea.reconstruction.front_kernels import advance
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions
from scan2fea.types import FloatArray, Scan


@dataclass(frozen=True, kw_only=True)
class FrontOptions(VisibilityOptions):
    wedge_rad: float = option(0.52, "advancing_front: candidates that turn by less count by their size alone", unit="rad", minimum=0.0, maximum=2.6)
    radius_ratio: float = option(
        5.0, "advancing_front: candidates that turn by more and whose ball is this many times larger are refused", minimum=1.0
    )


def front(tetra: Tetrahedralisation, normals: FloatArray | None = None, wedge_rad: float = 0.52, radius_ratio: float = 5.0) -> Pieces:
    """The triangles the front takes: a manifold with borders, one part per seed, coherently oriented within each part.

    normals : (n, 3) outward: triangles must face the side that their corners do, so that the front does not cross a wall; None for the plain front.
    """
    side = np.zeros((0, 3)) if normals is None else np.array(normals)
    radii = facet_radii(tetra.points, tetra.tets, tetra.neighbors, tetra.circumcentre, tetra.circumradius, tetra.n_input)
    one = (tetra.neighbors > np.arange(len(tetra))[:, None]) & np.isfinite(radii)
    rows = np.flatnonzero(one.ravel())
    seeds = rows[np.argsort(radii.ravel()[rows], kind="stable")]
    graph = (tetra.points, side, tetra.tets, tetra.neighbors, tetra.circumcentre)
    return Pieces.of(*advance(*graph, radii, seeds, tetra.n_input, float(wedge_rad), float(radius_ratio)))


def advancing_front(scan: Scan, options: VisibilityOptions = FrontOptions()) -> Reconstruction:
    """The surface of the front through the denoised points, closed. Raises ReconstructionError."""
    given = options if isinstance(options, FrontOptions) else FrontOptions()

    def pieces(tetra: Tetrahedralisation, normals: FloatArray, spacing_m: float) -> Pieces:
        return front(tetra, normals, given.wedge_rad, given.radius_ratio)

    return closed_reconstruction(scan, options, "advancing_front", pieces)
