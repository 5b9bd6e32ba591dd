"""Do points off the member lie together on a surface of their own? A diaphragm inside a tube is a few per cent of its points, as clutter may be.

Clutter is thin, and where it gathers it fills space; a surface that was scanned with the member is about as dense as the member's faces, and about
each of its points most others lie on one sheet, or half of them on each of two. A fillet and a dent are such surfaces too, but nearer to the member
than what counts here for most of their extent.

Points inside the solid lie where nothing can be seen: noise and clutter put no more of them there than as near to it outside. They are slots and
hollows, of which too few points may have been seen for a surface.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import bdtrc

from scan2fea.types import FloatArray, IntArray

CORNER = 0.07  # of the section's size: no fillet or rounded corner of the shipped table departs farther from sharp edges (HSS2X2X1/4: 0.068)
_FAR = 0.25  # of a surface's points lie farther off than that
_DENSITY = 0.25  # of the member's faces, where below it a face counts as not seen (`face_weights`)
CHANCE = 1e-3  # that clutter crowds so, or so many of it lie inside
_LEAST, _MOST = 12, 60  # points of one sheet about a point: fewer make sheets by chance, more are thinned out
_PLACES = 3  # of so many points that a group has at least
_STRAY_SIGMAS = 4.0
_CROWD = 3.0  # times as close as even clutter at least
_SIGMAS = 30.0  # radius of a neighbourhood at least: of points that fill it 0.27 lie within the sheet below
_THICK_SIGMAS, _BENT = 3.5, 1 / 16  # half of a sheet: noise of two points, and what a bend of eight radii shows
_THIN = 0.5  # half of a sheet over the standard deviation of the points in it at most: of a ball a third lies within
_ON_SHEET = 0.5  # of the points about one, and of a group's points those of which this holds
_SHEETS, _ASKED = 2, 300  # as close as faces about a point, and points of one group, that are looked at


def attached(local: FloatArray, off_m: FloatArray, sigma_m: float, size_m: float, per_m2: float, box_m3: float) -> int:
    """How many of the strays, about, lie on surfaces of their own.

    local : (n, 3) strays in the member's frame, metres.   off_m : (n,) distance to the member.   size_m : of the section.
    per_m2 : points of a face of the member that was seen.   box_m3 : about all points; strays spread evenly over it are clutter.
    """
    each = max(1, math.ceil(_DENSITY * per_m2 * math.pi * (_SIGMAS * sigma_m) ** 2 / _MOST))
    local, off_m, least_per_m2 = local[::each], off_m[::each], _DENSITY * per_m2 / each
    k = max(_LEAST, math.ceil(least_per_m2 * math.pi * (_SIGMAS * sigma_m) ** 2))
    radius = math.sqrt(k / (least_per_m2 * math.pi))
    k = max(k, math.ceil(_CROWD * len(local) * 4 / 3 * math.pi * radius**3 / box_m3))
    if len(local) <= k:
        return 0
    half = _THICK_SIGMAS * sigma_m + _BENT * radius
    found = 0
    for rows in _dense(local, k, radius):
        is_far = np.mean(off_m[rows] > CORNER * size_m + _STRAY_SIGMAS * sigma_m) >= _FAR
        if is_far and len(rows) > _PLACES * k and _is_sheet(local[rows], radius, half, k):
            found += each * len(rows)
    return found


def sunk(distance: FloatArray, reach: float, room: FloatArray | None = None) -> int:
    """Strays inside the solid beyond those outside that lie as near to it; 0 where chance deals them so (either side is as likely).

    distance : (n,) signed, to the surface, m: negative inside.   reach : of noise, m.   room : (k,) the same of places spread evenly over the scan.
    Outside there is more room as near to it, but where the clutter ends close to a solid bar: inside there is up to twice as much. With less room
    outside nothing is known of clutter, and what lies inside is none.
    """
    inside, outside = _sides(distance, reach)
    share = 0.5
    if room is not None:
        within, beside = _sides(room, reach)
        share = max(share, within / (within + beside)) if 2 * beside >= within > 0 else share
    by_chance = float(bdtrc(inside - 1, inside + outside, share)) if inside else 1.0  # that as many of them, or more, lie inside
    return round(inside - outside * share / (1.0 - share)) if by_chance < CHANCE else 0


def _sides(distance: FloatArray, reach: float) -> tuple[int, int]:
    """How many lie inside, and outside no farther off than the deepest of those."""
    return int((distance < -reach).sum()), int(((distance > reach) & (distance <= -float(distance.min(initial=0.0)))).sum())


def _dense(points: FloatArray, k: int, radius: float) -> list[IntArray]:
    """Rows of points (n, 3) that have k others within a radius, in groups that hang together by those."""
    distance, near = (np.asarray(one) for one in cKDTree(points).query(points, k=k + 1))
    is_dense = distance[:, -1] <= radius
    tail, head = np.repeat(np.arange(len(points)), k), near[:, 1:].ravel()
    both = is_dense[tail] & is_dense[head]
    graph = csr_array((np.ones(int(both.sum())), (tail[both], head[both])), shape=(len(points), len(points)))
    label = connected_components(graph, directed=False)[1][is_dense]
    order = np.argsort(label, kind="stable")
    cuts = np.flatnonzero(np.diff(label[order])) + 1
    return np.split(np.flatnonzero(is_dense)[order], cuts) if len(order) else []


def _is_sheet(points: FloatArray, radius: float, half: float, k: int) -> bool:
    """Whether about most of the points (n, 3) the others within a radius lie within half a thickness of it along one direction."""
    asked = points[:: math.ceil(len(points) / _ASKED)]
    distance, rows = (np.asarray(one) for one in cKDTree(points).query(asked, k=min(math.ceil(_SHEETS * k / _DENSITY), len(points))))
    near = np.asarray(distance <= radius)
    away = points[rows] - asked[:, None]
    sheet = near
    wide = np.zeros(len(asked), bool)
    for _ in range(3):
        count = sheet.sum(axis=1)[:, None]
        centred = (away - (away * sheet[..., None]).sum(axis=1, keepdims=True) / count[..., None]) * sheet[..., None]
        square, axes = np.linalg.eigh(np.einsum("mki,mkj->mij", centred, centred) / count[..., None])
        wide = half**2 <= _THIN**2 * np.sqrt(np.maximum(square[:, 1] * square[:, 2], 0.0))
        sheet = np.asarray(near & (np.abs(np.einsum("mki,mi->mk", away, axes[:, :, 0])) <= half))
    return bool(np.mean(wide & (sheet.sum(axis=1) >= _ON_SHEET * near.sum(axis=1))) >= _ON_SHEET)
