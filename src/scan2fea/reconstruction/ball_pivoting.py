"""Ball pivoting: a ball that rests on three points is turned about the edges of what is there until it rests on a further point; then a larger ball.

Bernardini, Mittleman, Rushmeier, Silva, Taubin, "The ball-pivoting algorithm for surface reconstruction", 1999. A ball that rests on three points
and holds none makes their triangle a facet of the Delaunay tets, and the next point it meets is a corner of one of the facets round the edge: so
nothing is searched for, the tets that the closing needs anyway are walked (`front_candidates`). `closing` makes the result the boundary of a
solid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.kernel.delaunay import Tetrahedralisation
from scan2fea.options import option
from scan2fea.reconstruction.closing import Pieces, closed_reconstruction
from scan2fea.reconstruction.front_kernels import pivot
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions
from scan2fea.types import FloatArray, Scan


@dataclass(frozen=True, kw_only=True)
class PivotOptions(VisibilityOptions):
    pivot_radii: tuple[float, ...] = option((1.0, 1.5, 2.5, 4.0), "ball_pivoting: radii of the balls, in spacings, ascending")


def pivoted(tetra: Tetrahedralisation, normals: FloatArray, balls_m: FloatArray) -> Pieces:
    """The triangles that balls of growing radius rest on from the side the normals of their corners point to: a manifold with borders.

    normals : (n, 3) outward.   balls_m : radii, m. Raises UsageError unless they are positive and ascend.
    """
    balls = np.asarray(balls_m, float)
    require(
        len(balls) > 0 and balls[0] > 0 and bool((np.diff(balls) > 0).all()),
        UsageError,
        f"reconstruction.pivot_radii {balls.tolist()}: give positive radii, smallest first",
    )
    n = tetra.n_input
    real = (tetra.neighbors > np.arange(len(tetra))[:, None]) & ((tetra.tets < n).sum(axis=1)[:, None] - (tetra.tets < n) == 3)
    seeds = np.flatnonzero(real.ravel())
    return Pieces.of(*pivot(tetra.points, np.ascontiguousarray(normals), tetra.tets, tetra.neighbors, tetra.circumcentre, seeds, n, balls))


def ball_pivoting(scan: Scan, options: VisibilityOptions = PivotOptions()) -> Reconstruction:
    """The surface that balls roll over on the denoised points, closed. Raises ReconstructionError; UsageError for wrong radii."""
    given = options if isinstance(options, PivotOptions) else PivotOptions()

    def pieces(tetra: Tetrahedralisation, normals: FloatArray, spacing_m: float) -> Pieces:
        return pivoted(tetra, normals, spacing_m * np.array(given.pivot_radii))

    return closed_reconstruction(scan, options, "ball_pivoting", pieces)
