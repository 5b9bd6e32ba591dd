"""When a surface must not be shipped: what the scan itself says against it.

Every check compares the finished surface with the raw points, or two independent ways of finding the same thing with each other. Limits
are those of reference/reconstruction.md ("Gates", "Refusal gate"); all are ratios, none is a length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from scan2fea.kernel.coverage import unmeasured_share
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.winding import layout, winding
from scan2fea.reconstruction.outside import Flood
from scan2fea.reconstruction.winding import sheet_areas
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh, Value

NOISE_OVER_WALL = 0.35  # above, the two faces of a wall mix: volume and thickness go wrong
SPACING_OVER_WALL = 1.1
UNMEASURED_SEEN, UNMEASURED_UNSEEN = 0.10, 0.02  # of the area, with and without sensor positions
REACH_SPACINGS, REACH_SIGMAS = 3.0, 3.0  # a place with no measured point of its own side nearer than this is not measured
SCATTER_MARGIN = 1.2  # the surface follows the points a little, so their distances are smaller than the noise
DEVIATION_SEEN = 2.5  # sigma
DEVIATION_UNSEEN = 2.0  # (sigma + 0.05 h)
STRAY = 0.01
CUT_AGREES = 0.90
WINDING_AGREES = 0.965
WINDING_AT_POINTS, WINDING_OFF = 0.05, 0.35
FLOOD_INSIDE = 0.05
SIGNS_AGREE, SIGNS_AGREE_QUIET, QUIET_NOISE = 0.94, 0.90, 0.17
OPEN_BOTH_SIDES = 0.15
INFERRED = 0.55  # of the area: the hidden face of a plate that lies on a table is a little less than half
MERGED, MERGED_KURTOSIS = 0.02, 1.6  # two sheets in one: residuals of two values have kurtosis 1, a normal distribution 3
CORE_KURTOSIS = 2.3  # two sheets +-t/2 with noise 0.3 t: 1.9; one sheet: 2.8 over 32 points
AT_POINTS_SOFTENING, OFF_POINTS_SOFTENING = 0.8, 0.4  # spacings; a place between two sheets of a wall must not feel its softening
KNOWN_WALL = 0.10  # share of points that must have a wall behind them before anything is said about its thickness
WALL_QUANTILE = 0.25  # the wall is judged by its thinner parts
PATCH = 32
SAME_FACE = 0.8  # cosine within a patch
SAMPLES = 6000


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence(Value):
    """A finished surface and the points it was made from.

    points : (n, 3) raw.   is_inferred : (n,) not measured, or None.   mesh : the closed surface.   smoothed, normals : (n, 3) denoised
    points and their outward normals.   thickness_m : (n,) to the other face, nan where there is none.   gap_m : (n,) to the next surface in
    front, nan likewise.   spacing_m, sigma_m : of the raw points.
    """

    points: FloatArray
    mesh: TriangleMesh
    smoothed: FloatArray
    normals: FloatArray
    thickness_m: FloatArray
    gap_m: FloatArray
    spacing_m: float
    sigma_m: float
    is_inferred: BoolArray | None = None

    _ROWS = (("points", "smoothed", "normals", "thickness_m", "gap_m", "is_inferred"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class Unseen(Value):
    """What is known besides where no sensor position is.

    flood : the answer that signed the normals.   polished : (n, 3) normals after the winding rounds.   held : share of the points under which
    the cut found the inside.   flood_inside : share of the volume inside that the ball had reached.
    """

    flood: Flood
    polished: FloatArray
    held: float
    flood_inside: float


def gates_seen(evidence: Evidence) -> tuple[Check, ...]:
    """The checks where sensor positions are known."""
    nearest = PointToMesh(evidence.mesh).nearest(_measured(evidence, evidence.points))
    sigma = _scatter(evidence, nearest.distance)
    limit = max(DEVIATION_SEEN * sigma, DEVIATION_UNSEEN * 0.05 * evidence.spacing_m)
    return (*_resolution(evidence), *_coverage(evidence, UNMEASURED_SEEN, sigma), _deviation(nearest.distance, limit))


def gates_unseen(evidence: Evidence, unseen: Unseen) -> tuple[Check, ...]:
    """The checks where sensor positions are not known: those above, and that four ways of telling the outside agree."""
    points = _measured(evidence, evidence.points)
    nearest = PointToMesh(evidence.mesh).nearest(points)
    normals = face_normals(evidence.mesh)[nearest.face]
    signed = np.einsum("ij,ij->i", points - nearest.closest, normals)
    sigma = _scatter(evidence, nearest.distance)
    residuals = _patch_moments(points, normals, signed)
    return (
        _both_faces(evidence.points, unseen.flood),
        *_resolution(evidence),
        *_coverage(evidence, UNMEASURED_UNSEEN, sigma),
        *_winding_agrees(evidence),
        _signs_agree(evidence, unseen),
        _cut_agrees(unseen.held),
        _flood_inside(unseen.flood_inside),
        _deviation(nearest.distance, DEVIATION_UNSEEN * (sigma + 0.05 * evidence.spacing_m)),
        _stray(nearest.distance, 3.0 * sigma + 0.5 * evidence.spacing_m),
        _merged(*residuals, 0.05 * evidence.spacing_m),
        *_solid_core(unseen.flood, *residuals, 0.05 * evidence.spacing_m),
    )


def wall_m(evidence: Evidence) -> float:
    """Thickness of the thinner walls (lower quartile over the points), m; nan where fewer than 10 % of the points have one behind them."""
    known = evidence.thickness_m[np.isfinite(evidence.thickness_m)]
    return float(np.quantile(known, WALL_QUANTILE)) if len(known) >= KNOWN_WALL * len(evidence.points) else math.nan


def failed(checks: tuple[Check, ...]) -> tuple[Check, ...]:
    """Those that did not pass."""
    return tuple(check for check in checks if not check.passed)


def _measured(evidence: Evidence, rows: FloatArray) -> FloatArray:
    return rows if evidence.is_inferred is None else rows[~evidence.is_inferred]


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"


def _scatter(evidence: Evidence, distance: FloatArray) -> float:
    """The noise that distances are held against: the stated one, unless half of the points lie much nearer than it would put them.

    Where the noise could not be told it was guessed high, and would excuse anything.
    """
    return min(evidence.sigma_m, SCATTER_MARGIN * 1.4826 * float(np.median(distance)) if len(distance) else 0.0)


def _around(points: FloatArray) -> str:
    """Where most of the points are, in words."""
    if not len(points):
        return ""
    x, y, z = np.median(points, axis=0)
    return f", around ({x:.4g}, {y:.4g}, {z:.4g}) m"


def _both_faces(points: FloatArray, flood: Flood) -> Check:
    share = flood.leak_share
    return Check(
        name="open on both sides",
        value=share,
        limit=OPEN_BOTH_SIDES,
        unit="1",
        passed=share <= OPEN_BOTH_SIDES,
        says=f"{share:.0%} of the points have open space on both sides (limit {OPEN_BOTH_SIDES:.0%}): the other face of what they lie on was not "
        f"scanned{_around(points[flood.open_both])}; scan it too, or fit the member",
    )


def _resolution(evidence: Evidence) -> tuple[Check, ...]:
    wall = wall_m(evidence)
    if not math.isfinite(wall):
        return ()
    noise, spacing = evidence.sigma_m / wall, evidence.spacing_m / wall
    return (
        Check(
            name="noise against wall",
            value=noise,
            limit=NOISE_OVER_WALL,
            unit="1",
            passed=noise <= NOISE_OVER_WALL,
            says=f"noise {_mm(evidence.sigma_m)} against a wall of {_mm(wall)}: limit {NOISE_OVER_WALL} x wall; scan with less noise, "
            "or fit the member",
        ),
        Check(
            name="spacing against wall",
            value=spacing,
            limit=SPACING_OVER_WALL,
            unit="1",
            passed=spacing <= SPACING_OVER_WALL,
            says=f"points {_mm(evidence.spacing_m)} apart against a wall of {_mm(wall)}: limit {SPACING_OVER_WALL} x wall; scan more densely, "
            "or fit the member",
        ),
    )


def _coverage(evidence: Evidence, limit: float, sigma_m: float) -> tuple[Check, ...]:
    """Area that neither measured nor inferred points back, and area that inferred ones alone do."""
    reach = REACH_SPACINGS * evidence.spacing_m + REACH_SIGMAS * sigma_m
    bare = unmeasured_share(evidence.mesh, evidence.points, reach)
    check = Check(
        name="unmeasured area",
        value=bare,
        limit=limit,
        unit="1",
        passed=bare <= limit,
        says=f"{bare:.0%} of the surface has no measured point of its side within {_mm(reach)} (limit {limit:.0%}): a side was not seen; "
        "scan it too, or fit the member",
    )
    if evidence.is_inferred is None or not evidence.is_inferred.any():
        return (check,)
    inferred = max(0.0, unmeasured_share(evidence.mesh, _measured(evidence, evidence.points), reach) - bare)
    return (
        check,
        Check(
            name="inferred area",
            value=inferred,
            limit=INFERRED,
            unit="1",
            passed=inferred <= INFERRED,
            says=f"{inferred:.0%} of the surface rests on inferred points alone (limit {INFERRED:.0%}): lift the part and scan the hidden side",
        ),
    )


def _deviation(distance: FloatArray, limit: float) -> Check:
    value = float(np.percentile(distance, 95)) if len(distance) else math.inf
    return Check(
        name="deviation p95",
        value=value,
        limit=limit,
        unit="m",
        passed=value <= limit,
        says=f"5 % of the points lie farther than {_mm(value)} from the surface, more than the noise explains ({_mm(limit)}): "
        "parts are missing or merged",
    )


def _stray(distance: FloatArray, far: float) -> Check:
    share = float(np.mean(distance > far))
    return Check(
        name="stray points",
        value=share,
        limit=STRAY,
        unit="1",
        passed=share <= STRAY,
        says=f"{share:.1%} of the points lie farther than {_mm(far)} from the surface (limit {STRAY:.0%}): a part was lost, or the cloud holds "
        "points that are not the object's",
    )


def _cut_agrees(held: float) -> Check:
    return Check(
        name="cut agrees with normals",
        value=held,
        limit=CUT_AGREES,
        unit="1",
        passed=held >= CUT_AGREES,
        says=f"the surface keeps the inside under only {held:.0%} of the points (limit {CUT_AGREES:.0%}): outside was not told from inside; "
        "give the sensor position",
    )


def _winding_agrees(evidence: Evidence) -> tuple[Check, Check]:
    """The dipoles of the points alone, which never saw the surface, must find it: w > 1/2 under it, < 1/2 above it, near 1/2 at the points."""
    tree = layout(evidence.smoothed)
    areas = sheet_areas(evidence.smoothed, evidence.normals)
    near, far = OFF_POINTS_SOFTENING * evidence.spacing_m, AT_POINTS_SOFTENING * evidence.spacing_m
    places, face = sample_surface(evidence.mesh, SAMPLES, seed=0)
    out = face_normals(evidence.mesh)[face]
    row = np.asarray(cKDTree(evidence.smoothed).query(places)[1], np.int64)
    h = evidence.spacing_m
    under, over = np.fmin(h, 0.45 * evidence.thickness_m[row])[:, None], np.fmin(h, 0.45 * evidence.gap_m[row])[:, None]
    inside, _ = winding(tree, evidence.normals, areas, near, places - under * out)
    outside, _ = winding(tree, evidence.normals, areas, near, places + over * out)
    right = float(np.mean(np.concatenate([inside > 0.5, outside < 0.5])))
    at_points, _ = winding(tree, evidence.normals, areas, far)
    lost = np.abs(at_points - 0.5) > WINDING_OFF
    off = float(np.mean(lost))
    return (
        Check(
            name="winding agrees with surface",
            value=right,
            limit=WINDING_AGREES,
            unit="1",
            passed=right >= WINDING_AGREES,
            says=f"the winding number of the points contradicts {1 - right:.1%} of the surface (limit {1 - WINDING_AGREES:.1%}): a face is missing "
            "from the scan; scan it too, or give the sensor position",
        ),
        Check(
            name="winding at points",
            value=off,
            limit=WINDING_AT_POINTS,
            unit="1",
            passed=off <= WINDING_AT_POINTS,
            says=f"{off:.0%} of the points do not lie between inside and outside (limit {WINDING_AT_POINTS:.0%}): the face opposite them is "
            f"missing from the scan{_around(evidence.points[lost])}; scan it too, or fit the member",
        ),
    )


def _flood_inside(share: float) -> Check:
    return Check(
        name="open space inside",
        value=share,
        limit=FLOOD_INSIDE,
        unit="1",
        passed=share <= FLOOD_INSIDE,
        says=f"{share:.0%} of the solid can be reached from outside between the points (limit {FLOOD_INSIDE:.0%}): the scan leaves it open there",
    )


def _signs_agree(evidence: Evidence, unseen: Unseen) -> Check:
    """The rolling ball and the winding number must find the same side out."""
    told = (unseen.flood.signed != 0).any(axis=1)
    same = np.einsum("ij,ij->i", unseen.flood.signed, unseen.polished) > 0
    share = float(same[told].mean()) if told.any() else 0.0
    wall = wall_m(evidence)
    # noise carries points past the middle of the wall, where the ball meets the other side first: they may disagree
    noisy = evidence.sigma_m >= QUIET_NOISE * wall  # a wall that is not known counts as thick
    limit = SIGNS_AGREE - float(ndtr(-0.5 * wall / evidence.sigma_m)) if noisy else SIGNS_AGREE_QUIET
    return Check(
        name="two ways of finding the outside agree",
        value=share,
        limit=limit,
        unit="1",
        passed=share >= limit,
        says=f"rolling ball and winding number agree at {share:.1%} of the points (limit {limit:.0%}): the outside is not certain; "
        "give the sensor position",
    )


def _patch_moments(points: FloatArray, normals: FloatArray, signed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Second and fourth central moments of the signed distances of patches of 32 neighbouring points of one side."""
    rows = np.linspace(0, len(points) - 1, min(len(points), SAMPLES)).astype(np.int64)
    if len(points) < PATCH:
        return np.zeros(0), np.zeros(0)
    near = np.asarray(cKDTree(points).query(points[rows], k=[*range(1, PATCH + 1)])[1], np.int64)
    same = np.einsum("nc,nkc->nk", normals[rows], normals[near]) > SAME_FACE
    count = same.sum(axis=1)
    mean = np.where(same, signed[near], 0.0).sum(axis=1) / np.maximum(count, 1)
    centred = np.where(same, signed[near] - mean[:, None], 0.0)
    second = (centred**2).sum(axis=1) / np.maximum(count, 1)
    fourth = (centred**4).sum(axis=1) / np.maximum(count, 1)
    full = count >= PATCH // 2
    return second[full], fourth[full]


def _merged(second: FloatArray, fourth: FloatArray, least: float) -> Check:
    """Patches whose distances have two values: two sheets that became one. `least`: spread below which nothing is said."""
    share = float(np.mean((second > least**2) & (fourth < MERGED_KURTOSIS * second**2))) if len(second) else 0.0
    return Check(
        name="merged sheets",
        value=share,
        limit=MERGED,
        unit="1",
        passed=share <= MERGED,
        says=f"at {share:.1%} of the points two sheets seem merged into one (limit {MERGED:.0%}): the wall is too thin for this noise; "
        "scan with less noise, or fit the member",
    )


def _solid_core(flood: Flood, second: FloatArray, fourth: FloatArray, least: float) -> tuple[Check, ...]:
    """A void taken as solid: what looks like noise on one sheet must not be the two sheets of a wall."""
    spread = second > least**2
    if not flood.core_solid or not spread.any():
        return ()
    kurtosis = float(np.mean(fourth[spread] / second[spread] ** 2))
    return (
        Check(
            name="solid core",
            value=kurtosis,
            limit=CORE_KURTOSIS,
            unit="1",
            passed=kurtosis >= CORE_KURTOSIS,
            says=f"an enclosed void may be hollow: the points lie in two sheets rather than one (kurtosis {kurtosis:.2f}, at least {CORE_KURTOSIS}); "
            "scan with less noise, or fit the member",
        ),
    )
