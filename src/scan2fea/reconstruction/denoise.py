"""Noise taken off the points of each side of a wall before the surface is cut: normals first, then positions along them.

Bilateral, predicted from the ORIGINAL neighbours in every round so that nothing shrinks (reference/reconstruction.md, steps 1-3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scan2fea.kernel.frame_noise import sigma_of_scans
from scan2fea.kernel.jit import jit
from scan2fea.kernel.noise import noise_sigma
from scan2fea.kernel.side_normals import (
    FLAT_SPACINGS,
    SAME_SIDE,
    Near,
    crease_normals,
    is_flat,
    near_lists,
    opposed_evidence,
    side_normals,
    spread_evidence,
    wall_depth,
)
from scan2fea.kernel.winding import layout, winding
from scan2fea.reconstruction.winding import SOFTENING, plain_areas
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

NORMAL_RADIUS = 2.5  # spacings
QUIET = 0.01  # of the spacing: noise below this is left alone
NORMAL_ROUNDS, POINT_ROUNDS = 5, 3
CLEAR = 0.3  # cosine of a sight line above which no noise of the normal hides the side
SEEN = 0.4  # mean cosine (of either sign) of the sight lines about a point below which its own may be clear by noise alone
NOT_FLAT = 0.1  # what a sight line counts where a patch is not flat: the plane through two faces is neither of them
MIXED = 4.0  # a wall thinner than this many thicknesses of its sheets lets them overlap
GRAZING = 0.15  # mean cosine of the sight lines below which a sheet's side is taken from the sheets that face it
WINDING_ROUNDS = 4
OPPOSED_ROUNDS, OPPOSED_REACH = 3, 30.0  # spacings
CLIP = 3.5  # sigma: a neighbour farther than this off the surface is of another one


@dataclass(frozen=True, eq=False, kw_only=True)
class Denoised(Value):
    """points, normals : (n, 3).   sigma_m : of the raw points.   residual_m : what is left of it, with safety (sigma_r).   radius_m : of the fits."""

    points: FloatArray
    normals: FloatArray
    sigma_m: float
    residual_m: float
    radius_m: float


class FirstNormals(NamedTuple):
    """normals : (n, 3) of one side, outward.   sigma_m : noise of the points, with that of their scans' places.   between_m : of these alone."""

    normals: FloatArray
    sigma_m: float
    between_m: float


def first_normals(points: FloatArray, toward: FloatArray, spacing_m: float, frame: IntArray | None = None) -> FirstNormals:
    """Same-side normals and the noise; fitted again in a wider radius where the noise swamps the first.

    toward : (n, 3) unit vectors on the outer side.   frame : (n,) the scan each point came from, where several may lie off each other.
    """
    radius = NORMAL_RADIUS * spacing_m
    for _ in range(3):
        near = near_lists(points, radius)
        normals = side_normals(near, toward)
        sigma = noise_sigma(points, normals, is_measured=None if frame is None else frame >= 0)
        if math.isfinite(sigma):
            normals = _settled(near, normals, toward, sigma, spacing_m, NOT_FLAT)
            sigma = noise_sigma(points, normals, is_measured=None if frame is None else frame >= 0)
        wider = min(4.0 * sigma, 6.0 * spacing_m) if math.isfinite(sigma) else 6.0 * spacing_m
        if wider <= 1.1 * radius:
            break
        radius = wider
    # asked of settled normals, once: in a wider radius the skins of a wall would mix, lie off each other by its thickness, and widen it again
    wide, between = sigma_of_scans(points, normals, _seen(frame, normals, toward), sigma)
    if between > 0.0:
        near = near_lists(points, max(radius, min(4.0 * wide, 6.0 * spacing_m)))
        again = _settled(near, side_normals(near, toward), toward, wide, spacing_m, 1.0)
        # wrong normals, a wall's skins mixed by them, tell the same: those fitted in the wider radius are wrong elsewhere, or no more
        if sigma_of_scans(points, again, _seen(frame, again, toward), sigma)[1] > 0.0:
            return FirstNormals(again, wide, between)
    return FirstNormals(normals, sigma if math.isfinite(sigma) else radius / 4.0, 0.0)


def _seen(frame: IntArray | None, normals: FloatArray, toward: FloatArray) -> IntArray | None:
    """The scan of each point (n,), -1 where its normal faces away from where it was seen: it is wrong, or of the other skin of a wall."""
    return None if frame is None else np.where(np.einsum("ij,ij->i", normals, toward) > 0.0, frame, -1)


def _settled(near: Near, normals: FloatArray, toward: FloatArray, sigma: float, spacing_m: float, not_flat: float) -> FloatArray:
    """Signs by what the whole sheet sees, by the rest of the surface where that is too little; creases given to one of their faces.

    not_flat : what a sight line counts where the patch is not flat: little at an edge, but scans that lie off each other are bent by nothing else.
    """
    thickness = 1.5 * sigma + FLAT_SPACINGS * spacing_m
    flat = is_flat(near, normals, sigma, spacing_m)
    own = np.einsum("ij,ij->i", normals, toward)
    # where the noise mixes the two sheets of a wall they silence each other: there a point that sees its side clearly knows better
    mixed = wall_depth(near.points, normals, spacing_m, MIXED * thickness) < MIXED * thickness
    # where all lines graze a face the normals that lean most, and wrongly, would be the clearest
    seen = np.add.reduceat(np.abs(own)[near.index], near.first[:-1]) / np.diff(near.first)
    clear = mixed & flat & (np.abs(own) >= CLEAR) & (seen >= SEEN)
    evidence = spread_evidence(near, normals, own * np.where(flat, 1.0, not_flat), clear, thickness)
    signed = np.where(evidence[:, None] < 0, -normals, normals)
    for _ in range(OPPOSED_ROUNDS):
        sure = np.abs(evidence) >= GRAZING
        if sure.all():
            break
        told = opposed_evidence(near.points, signed, sure, spacing_m, OPPOSED_REACH * spacing_m, 2.0 * thickness)
        told = np.where(sure, np.minimum(np.abs(evidence), 1.0), told)  # in the frame of `signed`, sure normals speak for themselves
        evidence = spread_evidence(near, signed, told, clear | sure, thickness)
        signed = np.where(evidence[:, None] < 0, -signed, signed)
        evidence = np.abs(evidence)
    return crease_normals(near, _by_winding(near.points, signed, np.abs(evidence) < GRAZING, spacing_m), toward, flat, thickness)


def _by_winding(points: FloatArray, normals: FloatArray, doubtful: BoolArray, spacing_m: float) -> FloatArray:
    """The normals, doubtful ones turned to where the winding number of all others falls."""
    if not doubtful.any() or doubtful.all():
        return normals
    axis, now = normals[doubtful], np.where(doubtful[:, None], 0.0, normals)
    tree, area = layout(points), plain_areas(points)
    for _ in range(WINDING_ROUNDS):
        outward = winding(tree, now, area, SOFTENING * spacing_m, points[doubtful])[1]
        now[doubtful] = np.where(np.einsum("ij,ij->i", outward, axis)[:, None] < 0, -axis, axis)
    return now


def denoise(points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float, between_m: float = 0.0) -> Denoised:
    """Points and normals with the noise averaged out over a radius R = max(2.2 h, 1.5 sigma / (0.12 sqrt(pi))).

    points : (n, 3) raw.   normals : (n, 3) outward.   sigma_m : their noise.   between_m : the part of it that all points of one scan have in common.
    """
    h = spacing_m
    radius = min(max(2.2 * h, 1.5 * sigma_m / (0.12 * math.sqrt(math.pi))), 8.0 * h)
    quiet = sigma_m < QUIET * h
    # residual noise of a mean over pi R^2 / h^2 points, times 1.9 for safety
    residual = max(0.02 * h, 0.0 if quiet else 1.9 * sigma_m * h / (math.sqrt(math.pi) * radius))
    tolerance = math.radians(15.0 if sigma_m < 0.02 * h else 25.0)
    xyz, now = np.ascontiguousarray(points, float), np.ascontiguousarray(normals, float)
    near = near_lists(xyz, radius)
    first, index = near.first, near.index
    for _ in range(NORMAL_ROUNDS):
        now = _smooth_normals(xyz, now, first, index, radius, tolerance)
    moved = xyz
    clip = CLIP * math.hypot(sigma_m, between_m)  # a point comes nearer to its surface, but stays in the place of its scan
    if not quiet:
        for _ in range(POINT_ROUNDS):
            moved = _smooth_points(xyz, moved, now, first, index, radius, tolerance, clip)
    return Denoised(points=moved, normals=now, sigma_m=sigma_m, residual_m=residual, radius_m=radius)


@jit
def _smooth_normals(points: FloatArray, normals: FloatArray, first: IntArray, index: IntArray, radius: float, tolerance: float) -> FloatArray:
    """One bilateral round: weight exp(-2 r^2 / R^2) exp(-angle^2 / (2 tolerance^2)) over the same side."""
    out = normals.copy()
    for p in range(len(points)):
        sx = sy = sz = 0.0
        for o in range(first[p], first[p + 1]):
            q = index[o]
            cosine = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
            if cosine <= SAME_SIDE:
                continue
            r2 = (points[q, 0] - points[p, 0]) ** 2 + (points[q, 1] - points[p, 1]) ** 2 + (points[q, 2] - points[p, 2]) ** 2
            angle = math.acos(min(1.0, cosine))
            w = math.exp(-2.0 * r2 / (radius * radius) - 0.5 * (angle / tolerance) ** 2)
            sx, sy, sz = sx + w * normals[q, 0], sy + w * normals[q, 1], sz + w * normals[q, 2]
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        if length > 0.0:
            out[p, 0], out[p, 1], out[p, 2] = sx / length, sy / length, sz / length
    return out


@jit
def _smooth_points(
    raw: FloatArray, now: FloatArray, normals: FloatArray, first: IntArray, index: IntArray, radius: float, tolerance: float, clip: float
) -> FloatArray:
    """One round: p += n_i * mean of (n_i + n_j).(raw_j - p) / |..|: to second order a smooth surface stays where it is."""
    out = now.copy()
    for p in range(len(raw)):
        total = shift = 0.0
        for o in range(first[p], first[p + 1]):
            q = index[o]
            cosine = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
            if cosine <= SAME_SIDE:
                continue
            x, y, z = raw[q, 0] - now[p, 0], raw[q, 1] - now[p, 1], raw[q, 2] - now[p, 2]
            mx, my, mz = normals[p, 0] + normals[q, 0], normals[p, 1] + normals[q, 1], normals[p, 2] + normals[q, 2]
            offset = (mx * x + my * y + mz * z) / (1.0 + cosine)
            if abs(offset) >= clip:
                continue
            angle = math.acos(min(1.0, cosine))
            r2 = (raw[q, 0] - raw[p, 0]) ** 2 + (raw[q, 1] - raw[p, 1]) ** 2 + (raw[q, 2] - raw[p, 2]) ** 2
            w = math.exp(-2.0 * r2 / (radius * radius) - 0.5 * (angle / tolerance) ** 2)
            total += w
            shift += w * offset
        if total > 0.0:
            shift /= total
            out[p, 0] += shift * normals[p, 0]
            out[p, 1] += shift * normals[p, 1]
            out[p, 2] += shift * normals[p, 2]
    return out
