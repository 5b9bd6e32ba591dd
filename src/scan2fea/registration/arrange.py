"""Which inputs stay where they are, which are corrected, which are registered, and which must be left out (docs/registration.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

from scan2fea.kernel.threads import in_threads
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.registration.pose_graph import GraphLink, GraphResult, components, optimise, rotation_vector
from scan2fea.registration.quality import BLOCKS, judge
from scan2fea.registration.register import LEAST_CONSISTENCY, LEAST_OVERLAP, Link, Matcher, Registered, is_sure, may_overlap, register
from scan2fea.registration.sight import is_station
from scan2fea.registration.surface import Surface, common_edge, surface_of
from scan2fea.types import BoolArray, FloatArray, Scan, Value

AGREE_SPACINGS = 3.0  # docs/design.md: median nearest distance where they overlap < 3 spacings + noise
SIGNIFICANT = 1e-4  # chance by which a pose that is right would be corrected
WORTH_SIGMAS, WORTH_EDGES = 0.5, 0.1  # a smaller correction changes no fit: half the noise, or what voxel means can tell
PARTNERS = 6  # of a frame that are compared in the check, those whose boxes share most


@dataclass(frozen=True, eq=False, kw_only=True)
class Arranged(Value):
    """T_world_frame : (n, 4, 4), nan where left out.   std_m, std_rad : (n,) of each frame's centre, nan where nothing tells.   reasons : why a
    frame was left out, or empty.   how : (n,) "kept", "agrees", "corrected", "registered", "too small", "left out".   notes : for the report.
    """

    T_world_frame: FloatArray
    placed: BoolArray
    std_m: FloatArray
    std_rad: FloatArray
    how: tuple[str, ...]
    reasons: tuple[str, ...]
    links: tuple[Link, ...]
    notes: tuple[str, ...]


def arrange(
    scans: Sequence[Scan],
    T_given: Sequence[FloatArray | None],
    fixed: Sequence[bool],
    names: Sequence[str],
    *,
    free: bool = False,
    correct: bool = False,
    unknown: str = "",
    seed: int = 0,
) -> Arranged:
    """Poses of all frames.

    T_given : a pose that a file gives, None where none does.   fixed : frames that are not looked at (inputs with faces).   free : given poses are
    not believed.   correct : frames that have a place are checked against each other, and moved where their surfaces say so.
    unknown : what is said of a frame without a pose that may not stay as it lies (the others have poses, so the file's own coordinates mean
    nothing); empty: it may. Never raises for what cannot be placed: it is left out with its reason.
    """
    n = len(scans)
    state = _State(T_given, names, free, unknown)
    open_ = [k for k in range(n) if not fixed[k] and len(scans[k].cloud)]
    if not free and not correct and all(T_given[k] is not None for k in open_):
        return state.arranged([k for k in range(n) if not len(scans[k].cloud)])
    edge = common_edge([scans[k].cloud.points for k in open_]) if len(open_) > 1 else 0.0
    if edge <= 0:
        return state.arranged([k for k in range(n) if not len(scans[k].cloud)])
    empty = Scan(cloud=scans[0].cloud.take(np.zeros(0, np.int64)))
    origins = [_origin(scans[k]) for k in range(n)]
    at_origin = [k in open_ and T_given[k] is None and not np.isfinite(origins[k][1]) and is_station(scans[k].cloud.points) for k in range(n)]
    origins = [(np.zeros(3), 0.0) if own else told for own, told in zip(at_origin, origins, strict=True)]
    surfaces = in_threads(lambda k: surface_of(scans[k] if k in open_ else empty, edge, np.zeros(3) if at_origin[k] else None), range(n))
    usable = [k for k in open_ if not surfaces[k].is_small]
    for k in open_:
        if surfaces[k].is_small and T_given[k] is None:
            state.how[k] = "too small"
    trusted = [] if free else _trusted(surfaces, usable, T_given, origins, state, seed)
    if correct and len(trusted) > 1:
        _correct(surfaces, trusted, state, seed)
    rest = [k for k in usable if k not in trusted]
    if rest and len(usable) > 1:
        _register_rest(surfaces, usable, trusted, state, [k for k in usable if at_origin[k]], seed)
    return state.arranged([k for k in range(n) if not len(scans[k].cloud)])


class _State:
    """What is known so far of each frame. Never leaves `arrange`."""

    def __init__(self, T_given: Sequence[FloatArray | None], names: Sequence[str], free: bool, unknown: str) -> None:
        n = len(T_given)
        self.unknown, self.free = unknown, free
        self.names = names
        self.pose = [np.eye(4) if T is None else np.array(T, float) for T in T_given]
        self.how = ["as it lies" if T is None or free else "kept" for T in T_given]
        self.std = np.full((n, 2), np.nan)
        self.reason = [""] * n
        self.links: list[Link] = []
        self.notes: list[str] = []

    def arranged(self, empty: Sequence[int]) -> Arranged:
        for k, how in enumerate(self.how):
            if self.unknown and how in ("as it lies", "too small"):
                self.how[k], self.reason[k] = "left out", self.unknown if how == "as it lies" else f"{self.unknown}, and it has too little shape"
        for k in empty:
            self.how[k], self.reason[k] = "left out", "it holds no point"
        placed = np.array([how != "left out" for how in self.how], bool)
        T = np.array([pose if is_placed else np.full((4, 4), np.nan) for pose, is_placed in zip(self.pose, placed, strict=True)]).reshape(-1, 4, 4)
        left = [f"{self.names[k]}: left out, {self.reason[k]}" for k in np.flatnonzero(~placed).tolist()]
        return Arranged(
            T_world_frame=T,
            placed=placed,
            std_m=self.std[:, 0].copy(),
            std_rad=self.std[:, 1].copy(),
            how=tuple(self.how),
            reasons=tuple(self.reason),
            links=tuple(self.links),
            notes=(*left, *self.notes),
        )


def _origin(scan: Scan) -> tuple[FloatArray, float]:
    """Where a scan was seen from: the middle, and how far from it the sensor was at most; nan where that is not known."""
    sensors = scan.sensors()
    if not len(sensors) or not np.isfinite(sensors).all():
        return np.full(3, np.nan), math.nan
    middle = 0.5 * (sensors.min(axis=0) + sensors.max(axis=0))
    return middle, float(np.linalg.norm(sensors - middle, axis=1).max())


def _trusted(
    surfaces: Sequence[Surface],
    usable: Sequence[int],
    T_given: Sequence[FloatArray | None],
    origins: Sequence[tuple[FloatArray, float]],
    state: _State,
    seed: int,
) -> list[int]:
    """Frames with a given pose, and those that agree with them as they lie; without given poses the largest group that agrees.

    Frames that were seen from one and the same place say nothing by lying close: they are in the sensor's own coordinates, and whether it moved
    is to be found out.
    """

    def one_place(a: int, b: int) -> bool:
        (p, r), (q, s) = origins[a], origins[b]
        return bool(np.linalg.norm(p - q) <= r + s + surfaces[a].edge_m)  # False where not known

    given = [k for k in usable if T_given[k] is not None]
    matcher = Matcher(surfaces, seed)

    def is_open(a: int, b: int) -> bool:
        if state.unknown or (T_given[a] is not None and T_given[b] is not None):
            return False
        return not (T_given[a] is None and T_given[b] is None and one_place(a, b))

    asked = [(a, b) for y, b in enumerate(usable) for a in usable[:y] if is_open(a, b)]
    agree = in_threads(lambda pair: _agree(matcher, *pair, inverse(state.pose[pair[0]]) @ state.pose[pair[1]]), asked)
    pairs = [(given[0], k) for k in given[1:]] + [pair for pair, ok in zip(asked, agree, strict=True) if ok]
    label = components(len(surfaces), pairs)
    groups: dict[int, list[int]] = {}
    for k in usable:
        groups.setdefault(label[k], []).append(k)
    if given:
        group = groups[label[given[0]]]
    else:
        group = max(groups.values(), key=lambda g: (len(g) > 1, sum(len(surfaces[k]) for k in g)), default=[])
        group = group if len(group) > 1 else []
    for k in group:
        if T_given[k] is None:
            state.how[k] = "agrees"
    return group


def _agree(matcher: Matcher, target: int, source: int, T: FloatArray) -> bool:
    """Median nearest distance where they overlap below 3 spacings + noise, and what comes near is mostly one surface."""
    a, b = matcher.surfaces[target], matcher.surfaces[source]
    if not may_overlap(a, b, T):
        return False
    quality = judge(b, a, matcher.tree(target), T)
    if not np.isfinite(quality.residual_m) or quality.overlap < LEAST_OVERLAP or quality.consistency < LEAST_CONSISTENCY:
        return False
    limit = AGREE_SPACINGS * np.nanmax([a.spacing_m, b.spacing_m]) + np.nan_to_num(np.nanmax([a.sigma_m, b.sigma_m, 0.0]))
    return bool(0.6745 * quality.residual_m < limit)  # residual_m is a standard deviation, the rule speaks of a median


def _correct(surfaces: Sequence[Surface], trusted: Sequence[int], state: _State, seed: int) -> None:
    """Check the frames that stay against each other; move those whose correction is significant."""
    matcher = Matcher(surfaces, seed)
    links = []
    for target, source in _partners(surfaces, trusted, state.pose):
        link = matcher.refine(target, source, inverse(state.pose[target]) @ state.pose[source], "check")
        if np.isfinite(link.quality.residual_m):
            links.append(link)
    state.links += links
    used = [link for link in links if link.used and (np.isfinite(link.quality.blocked) or is_sure(link.quality))]
    for group in _groups(trusted, used):
        own = [link for link in used if link.source in group and link.target in group]
        moved, result = _judged(surfaces, group, own, state.pose)
        for i, k in enumerate(group):
            state.std[k] = _std(result.covariance[i])
            if k in moved:
                d = displacement(surfaces[k], state.pose[k], result.T_world_frame[i])
                state.notes.append(f"{state.names[k]}: its pose was corrected by {d:.3g} m (std {state.std[k, 0]:.2g} m)")
                state.pose[k], state.how[k] = result.T_world_frame[i], "corrected"


def _partners(surfaces: Sequence[Surface], frames: Sequence[int], pose: Sequence[FloatArray]) -> list[tuple[int, int]]:
    """(target, source): of each frame the few others whose boxes share most with its own."""
    low, high = {}, {}
    for k in frames:
        moved = applied(pose[k], surfaces[k].points)
        low[k], high[k] = moved.min(axis=0) - surfaces[k].edge_m, moved.max(axis=0) + surfaces[k].edge_m
    pairs = set()
    for k in frames:
        shared = [(float(np.prod(np.maximum(np.minimum(high[k], high[j]) - np.maximum(low[k], low[j]), 0.0))), -j) for j in frames if j != k]
        for share, j in sorted(shared, reverse=True)[:PARTNERS]:
            if share > 0:
                pairs.add((min(k, -j), max(k, -j)))
    return sorted(pairs)


def _groups(frames: Sequence[int], links: Sequence[Link]) -> list[list[int]]:
    label = components(max(frames) + 1, [(link.target, link.source) for link in links])
    groups = [[k for k in frames if label[k] == c] for c in sorted({label[k] for k in frames})]
    return [group for group in groups if len(group) > 1]


def _judged(surfaces: Sequence[Surface], group: Sequence[int], links: Sequence[Link], pose: Sequence[FloatArray]) -> tuple[list[int], GraphResult]:
    """Frames of a group to be moved, and the poses with all others held where they are."""
    start = np.array([pose[k] for k in group])
    about = np.array([surfaces[k].points.mean(axis=0) for k in group])
    at = {k: i for i, k in enumerate(group)}
    graph = [graph_link(link, at) for link in links]
    result = optimise(start, graph, [0], about)
    gauge = _gauge(surfaces, group, start, result.T_world_frame)
    result = optimise(start, graph, [gauge], about)
    moved = [k for i, k in enumerate(group) if i != gauge and _is_significant(surfaces[k], start[i], result.T_world_frame[i], result.covariance[i])]
    if moved:
        result = optimise(start, graph, [at[k] for k in group if k not in moved], about)
    return moved, result


def graph_link(link: Link, at: dict[int, int]) -> GraphLink:
    """The link in the numbers of a group's frames."""
    return GraphLink(
        target=at[link.target],
        source=at[link.source],
        T_target_source=link.T_target_source,
        centre=link.quality.centre,
        information=link.quality.information,
    )


def _gauge(surfaces: Sequence[Surface], group: Sequence[int], start: FloatArray, found: FloatArray) -> int:
    """The frame that, held where it is, leaves the others nearest to where they are (median): one wrong frame must not move all others."""
    cost = []
    for g in range(len(group)):
        back = start[g] @ inverse(found[g])
        cost.append(float(np.median([displacement(surfaces[k], start[i], back @ found[i]) for i, k in enumerate(group)])))
    return int(np.argmin(cost))


def displacement(surface: Surface, T_a: FloatArray, T_b: FloatArray) -> float:
    """rms distance between the surface under two poses."""
    return float(np.sqrt(((applied(T_a, surface.points) - applied(T_b, surface.points)) ** 2).sum(axis=1).mean()))


def _is_significant(surface: Surface, T_start: FloatArray, T_found: FloatArray, covariance: FloatArray) -> bool:
    """More than chance (Wald's test with the degrees of freedom that the blocks leave), and more than matters.

    Where the sides of a wall cannot be told apart because the sensors are not known, only what contradicts the rule of agreement (3 spacings +
    noise) is corrected: a smaller step could lay the two faces of a wall on each other.
    """
    sigma = float(np.nan_to_num(surface.sigma_m))
    d = displacement(surface, T_start, T_found)
    least = max(WORTH_SIGMAS * sigma, WORTH_EDGES * surface.edge_m)
    if not surface.is_seen.all():
        least = max(least, AGREE_SPACINGS * surface.spacing_m + sigma)
    if d <= least:
        return False
    off = T_found @ inverse(T_start)
    centre = applied(T_start, surface.points).mean(axis=0)
    delta = np.concatenate([rotation_vector(off[:3, :3]), off[:3, :3] @ centre + off[:3, 3] - centre])
    wald = float(delta @ np.linalg.pinv(covariance, hermitian=True) @ delta)
    return wald > 6.0 * float(fdtri(6, BLOCKS**2, 1.0 - SIGNIFICANT))


def _register_rest(
    surfaces: Sequence[Surface], usable: Sequence[int], trusted: Sequence[int], state: _State, own: Sequence[int], seed: int
) -> None:
    """Search the place of the frames that nothing tells. own : frames in the coordinates of their scanner, which say nothing of where it stood."""
    known = [k for k in usable if not state.unknown or k in trusted]
    start: list[FloatArray | None] = [state.pose[k] if k in known else None for k in range(len(surfaces))]
    found = register(surfaces, start, held=trusted, seed=seed)
    state.links += list(found.links)
    alone = not trusted and not found.placed.any()
    if alone and not state.unknown:  # nothing could be registered: the first frame is the world
        found = _first_alone(found, usable[0])
    for k in usable:
        if k in trusted:
            continue
        if found.placed[k]:
            state.pose[k], state.how[k], state.std[k] = found.T_world_frame[k], "registered", _std(found.covariance[k])
        elif not (state.unknown or state.free or (k in own and len(own) > 1)) and _is_apart(surfaces, k, usable, state.pose):
            state.notes.append(f"{state.names[k]}: stays as it lies, beside the other inputs: {found.reasons[k]}")
        else:
            state.how[k] = "left out"
            state.reason[k] = f"{state.unknown}, and {found.reasons[k]}" if state.unknown else found.reasons[k]


def _first_alone(found: Registered, first: int) -> Registered:
    T, placed = found.T_world_frame.copy(), found.placed.copy()
    T[first], placed[first] = np.eye(4), True
    return Registered(
        T_world_frame=T, placed=placed, covariance=found.covariance, links=found.links, reasons=found.reasons, inflation=found.inflation
    )


def _is_apart(surfaces: Sequence[Surface], k: int, usable: Sequence[int], pose: Sequence[FloatArray]) -> bool:
    """True where the frame's box as it lies meets no other: parts or tiles of a scene in one frame of reference, which nothing contradicts."""
    return not any(may_overlap(surfaces[j], surfaces[k], inverse(pose[j]) @ pose[k]) for j in usable if j != k)


def _std(covariance: FloatArray) -> tuple[float, float]:
    turn, shift = float(np.trace(covariance[:3, :3])), float(np.trace(covariance[3:, 3:]))
    return float(np.sqrt(shift)) if shift >= 0 else np.nan, float(np.sqrt(turn)) if turn >= 0 else np.nan
