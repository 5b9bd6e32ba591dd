"""The solid of true faces where surfaces explain the points and meet in edges, with NURBS patches for the rest: what it lacks is freed, and again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.cad.body import Body
from scan2fea.cad.compared import triangles_of
from scan2fea.cad.freeform import tolerance
from scan2fea.cad.live import is_valid
from scan2fea.cad.quilted import quilted_solid
from scan2fea.cad.rims import Rimmed
from scan2fea.cad.sheets import RINGS, beyond
from scan2fea.cad.trued import Trued, covariance_in_mm, in_mm, no_solid, trued
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.types import FloatArray, IntArray, TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

FREED = 3  # rounds in which what lies off a solid becomes free form
CLOSELY = 0.03  # spacings, besides the noise, that patches may lie off the surface (rms)
BIAS, REFUSES = 0.003, 4.0  # of the volume; standard deviations by which the points of a face may lie to one side of it


def freed(body: Body, rims: Rimmed) -> Trued:
    """The solid of patches and of what their rims are told by; none where the points refuse it."""
    mesh, scale, patches, mm = body.mesh, body.scale, rims.patches, MILLIMETRES_PER_METRE
    fits, snaps, _ = body.fits(patches, radii=False, told=rims.told)
    middle, local = body.middle, body.local
    free = beyond(mesh, replace(patches, surfaces=tuple(f.surface for f in fits)), scale.reach_m)
    surfaces, covariances = [in_mm(f.surface, middle) for f in fits], [covariance_in_mm(f) for f in fits]
    closely = scale.tolerance_m * mm, scale.spacing_m * mm
    limits = tolerance(scale.spacing_m, scale.noise_m) * mm, (scale.noise_m + CLOSELY * scale.spacing_m) * mm
    label, volume = patches.label[body.face], enclosed_volume(mesh)
    reason = ""
    for _ in range(FREED):
        made = quilted_solid(local, patches.label, surfaces, covariances, *closely, free, *limits, scale.reach_m * mm)
        if made.solid is None or not is_valid(made.solid):
            return no_solid(reason or made.reason or "the faces close no valid solid")
        found = body.compared(made.solid, made.within / mm)
        shown = triangles_of(made.solid, middle, scale.tolerance_m, made.within / mm)[0]
        bias, std, refused = _bias(shown, body.used, label, volume)
        if not found.problem and abs(bias) <= BIAS + std:
            return trued(made.solid, middle, scale, snaps, found, within_m=made.within / mm, n_patches=made.n_patches)
        reason = reason or found.problem or f"the points say that true faces and patches hold {bias:+.1%} of the volume too much"
        if found.problem:
            off = PointToMesh(shown).nearest(mesh.vertices).distance > scale.stray_m
            more = made.free.copy()
            for _ in range(RINGS):
                more |= off[mesh.faces].any(1)
                off[mesh.faces[off[mesh.faces].any(1)]] = True
        else:
            more = made.free | np.isin(patches.label, refused)
        if (more == free).all():
            break
        free = more
    return no_solid(reason)


def _bias(shown: TriangleMesh, points: FloatArray, label: IntArray, volume: float) -> tuple[float, float, list[int]]:
    """By how much of its volume a solid is too large by the points, its standard deviation, and the surfaces whose points refuse them for part of it.

    label : (n,) surface of each point, -1 of none. The surface through the points rounds creases off, the points do not.
    """
    at = PointToMesh(shown).nearest(points)
    nearest = np.einsum("nk,nkx->nx", at.weights, shown.vertices[shown.faces[at.face]])
    off = -np.einsum("ij,ij->i", points - nearest, face_normals(shown)[at.face]) * float(face_areas(shown).sum()) / volume
    refused = []
    for k in np.unique(label[label >= 0]).tolist():
        own = off[label == k]
        part = float(own.sum()) / len(off)
        if abs(part) > BIAS / 3 and abs(float(own.mean())) > REFUSES * float(own.std()) / len(own) ** 0.5:
            refused.append(k)
    return float(off.mean()), float(off.std()) / len(off) ** 0.5, refused
