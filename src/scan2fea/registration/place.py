"""Put every input where its pose says or where `arrange` finds that it belongs, and measure how well the inputs then agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import EmptyScanError, InternalError, require
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows, spacing
from scan2fea.kernel.normals import normals_at
from scan2fea.kernel.threads import in_threads
from scan2fea.kernel.transforms import applied, rotated
from scan2fea.registration.arrange import Arranged, arrange
from scan2fea.registration.options import RegistrationOptions
from scan2fea.registration.register import Link
from scan2fea.registration.uncertainty import with_pose_noise
from scan2fea.types import FloatArray, PointCloud, Rays, Scan, Trajectory, Value

_QUERIES = 2_000  # points of a frame that are compared
_OTHERS = 100_000  # points of the other frames they are compared with
_OVERLAP_SPACINGS = 10.0  # farther from the others than this is not overlap but another part of the scene
_NOT_KNOWN = {
    "label": -1,
    "is_inferred": False,
    "intensity": np.nan,
    "sigma_along_m": np.nan,
    "sigma_across_m": np.nan,
    "normals": None,
    "colour": None,
}
_ASIDE_SPACINGS = 2.0
_PATCH = 12
_LEAST_OVERLAP = 0.2  # share of a frame's points that must overlap the others before their distance says anything
_AGREE_SPACINGS = 3.0  # docs/design.md: inputs agree if their median nearest distance where they overlap is below 3 spacings


@dataclass(frozen=True, eq=False, kw_only=True)
class Placed(Value):
    """All inputs in one frame.

    scan : the points of all placed inputs, `frame` = input number, rays moved with them.   agreement_m : (k,) median distance to the
    nearest point of the other inputs where they overlap, nan where they do not.   std_m, std_rad : (k,) standard deviation of each pose, nan
    where nothing tells it.   reasons : (k,) why an input was left out, or empty.   links : between pairs of inputs.   notes : sentences for the
    report.
    """

    scan: Scan
    trajectory: Trajectory
    agreement_m: FloatArray
    std_m: FloatArray
    std_rad: FloatArray
    reasons: tuple[str, ...]
    links: tuple[Link, ...]
    notes: tuple[str, ...]


def place(
    scans: Sequence[Scan],
    T_world_frame: Sequence[FloatArray | None],
    names: Sequence[str],
    options: RegistrationOptions = RegistrationOptions(),
    *,
    is_placed: Sequence[bool] = (),
    is_fixed: Sequence[bool] = (),
) -> Placed:
    """Join the scans into one.

    T_world_frame : one per scan, None where the file of poses does not name it or there is none.   is_placed : scans whose own file has applied
    their pose (their T_world_frame may be None).   is_fixed : scans that must stay (inputs with faces). In mode "placed" a scan without a pose
    stays as it lies if no file of poses was given, else it is left out, because its place is not known.
    Raises EmptyScanError if no point is left.
    """
    n = len(scans)
    require(n == len(T_world_frame) == len(names), InternalError, "place needs one pose and one name per scan")
    own, fixed = [*is_placed, *[False] * (n - len(is_placed))], [*is_fixed, *[False] * (n - len(is_fixed))]
    arranged = _as_told(scans, T_world_frame, names, options)
    if options.mode != "placed" and n > 1:
        given = [np.eye(4) if T is None and (stays or stuck) else T for T, stays, stuck in zip(T_world_frame, own, fixed, strict=True)]
        unknown = f"{options.poses} gives no pose for it" if options.poses else ""
        arranged = arrange(scans, given, fixed, names, free=options.mode == "free", correct=options.correct, unknown=unknown, seed=options.seed)
    poses = [T if ok else None for T, ok in zip(arranged.T_world_frame, arranged.placed, strict=True)]
    kept = [frame for frame, T in enumerate(poses) if T is not None]
    require(sum(len(scans[frame].cloud) for frame in kept), EmptyScanError, "no input is left after placing: none has a point and a pose")
    scan = joined(
        [_doubted(scans[frame], arranged.std_m[frame], arranged.std_rad[frame]) for frame in kept],
        [arranged.T_world_frame[frame] for frame in kept],
        kept,
    )
    agreement, limit = _agreement(scan, n)
    return Placed(
        scan=scan,
        trajectory=Trajectory(T_world_frame=arranged.T_world_frame, placed=arranged.placed),
        agreement_m=agreement,
        std_m=arranged.std_m,
        std_rad=arranged.std_rad,
        reasons=arranged.reasons,
        links=arranged.links,
        notes=(*arranged.notes, *_disagreements(agreement, limit, names)),
    )


def _as_told(scans: Sequence[Scan], T_world_frame: Sequence[FloatArray | None], names: Sequence[str], options: RegistrationOptions) -> Arranged:
    """Every scan where its file or the file of poses puts it."""
    as_it_lies = np.eye(4) if not options.poses else None
    poses = [as_it_lies if T is None else T for T in T_world_frame]
    placed = np.array([T is not None for T in poses], bool)
    reasons = tuple("" if ok else f"{options.poses} gives no pose for it" for ok in placed)
    nothing = np.full(len(scans), np.nan)
    return Arranged(
        T_world_frame=np.array([np.full((4, 4), np.nan) if T is None else T for T in poses]).reshape(-1, 4, 4),
        placed=placed,
        std_m=nothing,
        std_rad=nothing,
        how=tuple("kept" if ok else "left out" for ok in placed),
        reasons=reasons,
        links=(),
        notes=tuple(f"{names[k]}: left out, {reasons[k]}" for k in np.flatnonzero(~placed).tolist()),
    )


def _doubted(scan: Scan, std_m: float, std_rad: float) -> Scan:
    return replace(scan, cloud=with_pose_noise(scan.cloud, float(std_m), float(std_rad)))


def joined(scans: Sequence[Scan], T_world_frame: Sequence[FloatArray] = (), frames: Sequence[int] = ()) -> Scan:
    """One scan of all points and rays, in order, each scan moved by its pose and its points numbered as its frame (none given: as they are).

    A column that some inputs lack is filled for `label` (-1), `is_inferred` (False), `intensity` and the sigmas (nan), and dropped for normals and
    colour, which have no value that says "not known". Column by column, so that no second copy of all columns is held.
    """
    first = np.cumsum([0] + [0 if s.rays is None else len(s.rays) for s in scans])
    rays = [np.where(s.cloud.ray >= 0, s.cloud.ray + offset, -1) for s, offset in zip(scans, first, strict=False)]
    columns = {"ray": np.concatenate(rays)}
    del rays
    poses = T_world_frame or [np.eye(4)] * len(scans)
    columns["points"] = np.concatenate([_by(applied, T, s.cloud.points) for s, T in zip(scans, poses, strict=True)])
    sizes = [len(s.cloud) for s in scans]
    columns["frame"] = np.repeat(np.array(frames, np.int64), sizes) if frames else np.concatenate([s.cloud.frame for s in scans])
    columns["raw_index"] = np.concatenate([s.cloud.raw_index for s in scans])
    for name, filler in _NOT_KNOWN.items():
        given = [getattr(s.cloud, name) for s in scans]
        if all(g is None for g in given) or (filler is None and any(g is None for g in given)):
            continue
        if name == "normals":
            given = [_by(rotated, T, g) for T, g in zip(poses, given, strict=True)]
        columns[name] = np.concatenate([np.full(len(s.cloud), filler) if g is None else g for s, g in zip(scans, given, strict=True)])
    seen = [(s.rays, T) for s, T in zip(scans, poses, strict=True) if s.rays is not None]
    return Scan(cloud=PointCloud(**columns), rays=_joined_rays(seen))


def _joined_rays(rays: Sequence[tuple[Rays, FloatArray]]) -> Rays | None:
    if not rays:
        return None
    columns = {
        "origin": np.concatenate([_by(applied, T, r.origin) for r, T in rays]),
        "direction": np.concatenate([_by(rotated, T, r.direction) for r, T in rays]),
        "range_m": np.concatenate([r.range_m for r, _ in rays]),
    }
    for name in ("time_s", "ring", "footprint_rad"):
        given = [getattr(r, name) for r, _ in rays]
        if all(g is not None for g in given):
            columns[name] = np.concatenate(given)
    return Rays(**columns)


def _by(how: Callable[[FloatArray, FloatArray], FloatArray], T_world_frame: FloatArray, rows: FloatArray) -> FloatArray:
    """Moved rows; bytes stay as they were where the pose is none."""
    return rows if np.array_equal(T_world_frame, np.eye(4)) else how(T_world_frame, rows)


def _agreement(scan: Scan, n_frames: int) -> tuple[FloatArray, FloatArray]:
    """(k,) distance per frame, and (k,) what it may be, from a seeded draw of its points against a seeded draw of the others'.

    Points overlap where the other surface lies over or under them, not beside them (a neighbouring part of the object). Points seen from
    opposite sides are two faces of a wall, not one surface: they are left out where the sensors are known.
    """
    cloud = scan.cloud
    if not len(cloud) or cloud.frame.min() == cloud.frame.max():
        return np.full(n_frames, np.nan), np.full(n_frames, np.nan)

    def look(frame: int) -> tuple[float, float]:
        mine, rest = np.flatnonzero(cloud.frame == frame), np.flatnonzero(cloud.frame != frame)
        if len(mine) < 2 or len(rest) < 2:
            return math.nan, math.nan
        rest = rest[sampled_rows(len(rest), _OTHERS, frame)]
        own, others, drawn = cloud.points[mine], cloud.points[rest], sampled_rows(len(mine), _QUERIES, frame)
        distance, nearest = k_nearest(others, 1, own[drawn])
        h = max(spacing(own), spacing(others))
        normal = normals_at(own[drawn], own, _PATCH)
        offset = others[nearest[:, 0]] - own[drawn]
        aside = np.linalg.norm(offset - np.einsum("nc,nc->n", offset, normal)[:, None] * normal, axis=1)
        near = (distance[:, 0] <= _OVERLAP_SPACINGS * h) & (aside <= _ASIDE_SPACINGS * h)
        views = (scan.sensors(rows) - cloud.points[rows] for rows in (mine[drawn], rest[nearest[:, 0]]))
        side = np.prod([np.einsum("nc,nc->n", normal, view) for view in views], axis=0)
        near &= ~(side <= 0)  # nan, a view not known, counts as the same side
        return (float(np.median(distance[near, 0])), _AGREE_SPACINGS * h) if near.mean() >= _LEAST_OVERLAP else (math.nan, math.nan)

    median, limit = np.array(in_threads(look, range(n_frames))).T
    return median, limit


def _disagreements(agreement: FloatArray, limit: FloatArray, names: Sequence[str]) -> list[str]:
    bad = []
    for frame in np.flatnonzero(agreement > limit).tolist():  # False where nan
        says = f"lies {agreement[frame]:.3g} m from the other inputs where they overlap (limit {limit[frame]:.3g} m); check its pose"
        bad.append(f"{names[frame]}: {says}")
    return bad
