"""A capture of many turns of one scanner becomes one scan: its motion is told by a timed trajectory, or found (docs/registration.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.io import RawScan
from scan2fea.kernel.trajectories import between
from scan2fea.registration import VISIBLE, Odometry, RegistrationOptions, Sweeps, at_times, has_changed, moved, odometry
from scan2fea.types import FloatArray, IntArray, Rays, Scan, Trajectory, Value

HOUR_S = 3600.0  # the clock of a Velodyne unit begins again
_MAD = 1.4826
_STOOD = ", or registration.sweeps = as_they_lie where only things before it moved"
_PARTS, _FEW = 64, 0.02  # of a turn; a part with so few returns of the fullest is empty


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepPath(Value):
    """How the scanner of one input moved. frame : number of the input.   time_s : (k,).   T_frame_scanner : (k, 4, 4) to the input's frame; those
    given, or one per sweep in the middle of its returns.   std_m, std_rad : (k,) relative to the first (told by other sensors: to the world), nan
    where a file gave the poses.
    """

    frame: int
    time_s: FloatArray
    T_frame_scanner: FloatArray
    std_m: FloatArray
    std_rad: FloatArray


Unrolled = tuple[RawScan, SweepPath | None, str]


def unrolled(raw: RawScan, frame: int, options: RegistrationOptions, given: Trajectory | None) -> Unrolled:
    """The input with its motion taken out, the way of its scanner, and ""; itself and None where it is one turn, has no times, or is to stay as it
    lies. Where a motion was searched, is there and was not found: itself, None and why nothing can be made of its points.

    given : a timed trajectory of this scanner. Raises InputError where its times are of another scan.
    """
    rays = raw.scan.rays
    if raw.sweep is None or rays is None or rays.time_s is None or bool((raw.scan.cloud.ray < 0).any()):
        return raw, None, ""
    if given is None and options.sweeps == "as_they_lie":
        return raw, None, ""
    time = unwrapped(rays.time_s[raw.scan.cloud.ray])
    if given is not None and given.time_s is not None:
        time = time + HOUR_S * round((float(given.time_s[0]) - float(time.min())) / HOUR_S)
        first, share = at_times(given, time)
        std_m, std_rad = _std(given)
        path = SweepPath(frame=frame, time_s=given.time_s, T_frame_scanner=given.T_world_frame, std_m=std_m, std_rad=std_rad)
        told = "registration.poses" if given.covariance is None else "the inertial unit and the logs beside it"
        says = f"its motion was taken out by the trajectory of {told}"
        return replace(_moved(raw, given.time_s, given.T_world_frame, first, share, says), pose_given=True), path, ""
    period = period_of(time, raw.sweep)
    return _by_odometry(raw, rays, frame, time, period, options.sweeps == "odometry") if period > 0 else (raw, None, "")


def cut_in_sweeps(points: FloatArray, rays: Rays, ray: IntArray, time_s: FloatArray, period_s: float) -> tuple[Sweeps, float]:
    """Points (n, 3) of turns of `period_s` as sweeps that begin where a turn has no returns, and when (s) the first of them begins. ray : (n,)"""
    begun = _cut(time_s, period_s)
    at = (time_s - begun) / period_s
    sweep = np.floor(at).astype(np.int64)
    order = np.lexsort((at, sweep))
    begun += period_s * int(sweep[order[0]])
    sweep, share = sweep[order] - int(sweep[order[0]]), (at - sweep)[order]
    ring = None if rays.ring is None else rays.ring[ray][order]
    return Sweeps(points=points[order], sweep=sweep, share=share, period_s=period_s, gap_rad=_gap(rays), ring=ring), begun


def _by_odometry(raw: RawScan, rays: Rays, frame: int, time: FloatArray, period: float, asked: bool) -> Unrolled:
    """The input with the motion taken out that its sweeps tell; as it lies, with the reason, where they tell none that can be believed.

    Unless it was asked for, nothing is searched where the beams end as they did.
    """
    sweeps, begun = cut_in_sweeps(raw.scan.cloud.points, rays, raw.scan.cloud.ray, time, period)
    sigma = range_noise(rays, raw.scan.cloud.ray, time)
    if not asked and not has_changed(sweeps, sigma):
        return raw, None, ""
    found = odometry(sweeps, sigma)
    if not found.is_sure:
        why = _why_not(found)
        moved_too = found.changed > VISIBLE
        smeared = f"{why}, and it moved ({found.changed:.0%} of its beams end elsewhere): give it with --poses{_STOOD}" if moved_too else ""
        return replace(raw, notes=(*raw.notes, f"{why}: it stays as it lies; give its motion with --poses")), None, smeared
    if found.stands:
        reach = float(np.linalg.norm(found.T_world_sweep[:, :3, 3], axis=1).max())
        says = f"its scanner stood still: {len(sweeps)} sweeps were taken for one (they move by at most {reach:.2g} m, which is no more than chance)"
        return replace(raw, notes=(*_without_turns(raw), says)), None, ""
    knots = np.asarray(begun + period * np.arange(len(found.T_world_knot)), np.float64)
    told = np.asarray(knots[:-1] + period * found.middle)
    path = SweepPath(frame=frame, time_s=told, T_frame_scanner=found.T_world_sweep, std_m=found.std_m, std_rad=found.std_rad)
    far = float(np.linalg.norm(found.T_world_sweep[-1, :3, 3]))
    says = (
        f"{len(sweeps)} sweeps of a moving scanner were put together: it went {far:.3g} m; its last place has a standard deviation of "
        f"{float(found.std_m[-1]):.2g} m and {np.degrees(float(found.std_rad[-1])):.2g} degrees against its first; "
        f"distant sweeps contradict {found.agreement.contradicted:.1%} of each other's points at most ({found.agreement.limit:.0%} allowed)"
    )
    at = (time - begun) / period
    first = np.floor(at).astype(np.int64)
    return _moved(raw, knots, found.T_world_knot, first, at - first, says), path, ""


def _why_not(found: Odometry) -> str:
    """One sentence with the figure that forbids to believe a motion."""
    if found.is_stuck:
        return f"its motion could not be found: none is seen, yet {found.changed:.0%} of the beams end elsewhere than at first"
    if found.is_open:
        x, y, z = found.slide.tolist()
        return f"its motion could not be found: what it saw leaves it free to slide by {found.slide_m:.2g} m along ({x:.2f}, {y:.2f}, {z:.2f})"
    told = found.agreement
    if not told.holds and not math.isnan(told.contradicted):
        return (
            f"its motion could not be found: under the best motion the beams of sweep {told.pair[1] + 1} contradict {told.contradicted:.0%} of what "
            f"sweep {told.pair[0] + 1} saw ({told.limit:.0%} allowed)"
        )
    if not told.holds:
        return "its motion could not be found: no two sweeps see the same part of the scene"
    return f"its motion could not be found: forwards and backwards in time differ by {found.disagreement_m:.2g} m"


def _moved(raw: RawScan, knots: FloatArray, T_frame_knot: FloatArray, first: IntArray, share: FloatArray, says: str) -> RawScan:
    """Every point and its ray where the scanner was at their moment; those without return too, where the file told their moment. knots : (k,) s"""
    cloud, rays = raw.scan.cloud, raw.scan.rays
    if rays is None:
        return raw
    points = moved(cloud.points, T_frame_knot, first, share)
    lost, its_first, its_share = _without_return(rays, cloud.ray, knots)
    rows, first, share = np.concatenate([cloud.ray, lost]), np.concatenate([first, its_first]), np.concatenate([share, its_share])
    R, _ = between(T_frame_knot, first, share)
    scan = Scan(
        cloud=cloud.replaced(points=points, ray=np.arange(len(cloud), dtype=np.int64), normals=None),
        rays=Rays(
            origin=moved(rays.origin[rows], T_frame_knot, first, share),
            direction=np.einsum("nij,nj->ni", R, rays.direction[rows]),
            range_m=rays.range_m[rows],
            time_s=None if rays.time_s is None else rays.time_s[rows],
            ring=None if rays.ring is None else rays.ring[rows],
        ),
    )
    return replace(raw, scan=scan, notes=(*_without_turns(raw), says))


def _without_return(rays: Rays, used: IntArray, knots: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows of the rays that met nothing within the time of the knots, the knot before each and the share of the way to the next."""
    is_used = np.zeros(len(rays), bool)
    is_used[used] = True
    time = np.full(len(rays), np.nan) if rays.time_s is None else rays.time_s
    time = time + HOUR_S * np.round((0.5 * (knots[0] + knots[-1]) - time) / HOUR_S)
    rows = np.flatnonzero(~is_used & np.isnan(rays.range_m) & (time >= knots[0]) & (time <= knots[-1]))
    first = np.clip(np.searchsorted(knots, time[rows], side="right") - 1, 0, len(knots) - 2).astype(np.int64)
    return rows, first, np.asarray((time[rows] - knots[first]) / (knots[first + 1] - knots[first]))


def _without_turns(raw: RawScan) -> tuple[str, ...]:
    return tuple(note for note in raw.notes if "turns, all in the frame of the sensor" not in note)


def _std(given: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Standard deviations of place and turn (root of the trace), nan where the trajectory states none."""
    if given.covariance is None:
        return np.full(len(given.T_world_frame), np.nan), np.full(len(given.T_world_frame), np.nan)
    P = given.covariance
    return np.sqrt(np.trace(P[:, :3, :3], axis1=1, axis2=2)), np.sqrt(np.trace(P[:, 3:, 3:], axis1=1, axis2=2))


def unwrapped(time_s: FloatArray) -> FloatArray:
    """Times past the hour, across the hour."""
    return np.asarray(np.where(time_s < time_s.max() - HOUR_S / 2, time_s + HOUR_S, time_s)) if np.ptp(time_s) > HOUR_S / 2 else time_s


def period_of(time_s: FloatArray, turn: IntArray) -> float:
    """Of a turn, s."""
    used, packed = np.unique(turn, return_inverse=True)
    begun = np.full(len(used), np.inf)
    np.minimum.at(begun, packed, time_s)
    steps = np.diff(begun[1:]) if len(used) > 3 else np.diff(begun)
    return float(np.median(steps / np.diff(used[1:] if len(used) > 3 else used)))


def _cut(time_s: FloatArray, period: float) -> float:
    """When the first sweep begins: in the middle of the longest stretch of a turn without returns, so that no thing is cut in two moments."""
    start = float(time_s.min())
    share = ((time_s - start) / period) % 1.0
    count = np.bincount((share * _PARTS).astype(np.int64), minlength=_PARTS)[:_PARTS]
    empty = count <= _FEW * count.max()
    if not empty.any() or empty.all():
        return start
    twice = np.concatenate([empty, empty]).astype(np.int64)
    run = np.zeros(2 * _PARTS, np.int64)
    for k in range(2 * _PARTS):
        run[k] = (run[k - 1] + 1 if k else 1) * twice[k]
    end = int(np.argmax(np.minimum(run, _PARTS)))
    middle = ((end + 1 - 0.5 * float(run[end])) / _PARTS) % 1.0
    return float(start + (middle - 1.0) * period)


def _gap(rays: Rays) -> float:
    """Angle between neighbouring beams of the fan, rad, 0 where it is one beam or not known: from ring to ring by their elevation about the turning
    axis, or along a ring where that is more. Beams that did not come back have no ring (-1).
    """
    if rays.ring is None:
        return 0.0
    ring, direction = rays.ring[rays.ring >= 0], rays.direction[rays.ring >= 0]
    elevation = np.arcsin(np.clip(direction[:, 2], -1.0, 1.0))
    of_ring = np.sort([float(np.median(elevation[ring == one])) for one in np.unique(ring)])
    if len(of_ring) < 2:
        return 0.0
    order = np.argsort(ring, kind="stable")
    along = np.linalg.norm(np.diff(direction[order], axis=0), axis=1)[np.diff(ring[order]) == 0]
    return max(float(np.median(np.diff(of_ring))), float(np.median(along)) if len(along) else 0.0)


def range_noise(rays: Rays, ray: IntArray, time_s: FloatArray) -> float:
    """Standard deviation of a range from second differences along each ring, by their median."""
    ring = np.zeros(len(ray), np.int64) if rays.ring is None else rays.ring[ray]
    order = np.lexsort((time_s, ring))
    r, same = rays.range_m[ray][order], ring[order]
    second = np.abs(r[2:] - 2.0 * r[1:-1] + r[:-2])[same[2:] == same[:-2]]
    return float(_MAD * np.median(second) / np.sqrt(6.0)) if len(second) else 0.0
