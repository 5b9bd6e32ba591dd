"""Gaps of round faces that were seen on both sides: a draughtsman goes on with the cylinder, and says so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.surfaces import Surface
from scan2fea.reconstruction.flat_gaps import BORDER, MOST_CARRIED, SKIN
from scan2fea.reconstruction.hidden_volume import REACH
from scan2fea.reconstruction.pictures import Rolled, patches, pictures
from scan2fea.reconstruction.sight import Sight
from scan2fea.types import BoolArray, FloatArray, TriangleMesh

PASSED = 0.1  # of the places in the middle of the wall under a gap that sight lines may pass, as noise lets a few: more have seen an opening


def over_rounds(mesh: TriangleMesh, points: FloatArray, spacing_m: float, rolled: Mapping[int, Surface], sight: Sight) -> FloatArray:
    """(k, 3) places on gaps of cylinders (regions of `mesh` that `rolled` names) with measured places on both sides, round or along.

    points : (n, 3) measured. Only where most of the face was measured, and no sight line passes under the gap: there is no window that one saw.
    """
    out, scene = [np.zeros((0, 3))], scene_of(mesh)
    for picture in pictures(mesh, points, spacing_m, REACH * spacing_m, rolled).values():
        if not isinstance(picture.sheet, Rolled):
            continue
        far = picture.far(BORDER * spacing_m)
        if far.sum() > MOST_CARRIED * picture.inside.sum():
            continue
        enclosed = far & between(picture.inside & ~far)
        for at in patches(far):
            at = at[enclosed[tuple(at.T)]]
            if not len(at):
                continue
            places, way = picture.places(at), -picture.normals(at)
            wall, _ = first_hits(scene, places + SKIN * spacing_m * way, way)
            middle = places + np.minimum(0.5 * wall, sight.skin_m + spacing_m)[:, None] * way
            if sight.passes(middle).mean() <= PASSED:
                out.append(places)
    return np.concatenate(out)


def between(seen: BoolArray) -> BoolArray:
    """(r, c) pixels with seen ones on both sides of them, in their row or in their column."""
    out = np.zeros(seen.shape, bool)
    for axis in (0, 1):
        before = np.logical_or.accumulate(seen, axis=axis)
        after = np.flip(np.logical_or.accumulate(np.flip(seen, axis=axis), axis=axis), axis=axis)
        out |= before & after
    return out
