"""Poses of many frames without an initial guess, or from one: links between pairs, then one consistent graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.near_tree import NearTree
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.registration.concatenate import along_tree
from scan2fea.registration.features import features
from scan2fea.registration.icp import icp
from scan2fea.registration.pairing import pairs_of
from scan2fea.registration.pose_graph import GraphLink, GraphOptions, GraphResult, components, optimise, rotation_vector, triangles_closed
from scan2fea.registration.quality import Quality, judge
from scan2fea.registration.ransac import Features, Proposal, RansacOptions, propose
from scan2fea.registration.surface import Surface, sees_through
from scan2fea.registration.worlds import Arranger, Guess
from scan2fea.types import BoolArray, FloatArray, Value

LEAST_OVERLAP = 0.15  # of the smaller frame
LEAST_CONSISTENCY = 0.55  # of what is near must lie on: right links of real scans 0.59 .. 0.94, wrong ones 0.20 .. 0.49 (docs/registration.md)
SEEN_CONSISTENCY = 0.4  # enough where both stations are known and no ray is blocked: what one sees of a corner the other may not
SURE_CONSISTENCY, SURE_OVERLAP = 0.75, 0.5  # a neighbour in a sequence that is this sure needs no search
ALL_PAIRS = 12  # up to so many frames every pair is searched; beyond, neighbours in the order of the inputs
NEIGHBOURS = 2
MOST_BLOCKED = 0.05  # of the rays through a nearer surface: the limit of docs/design.md for a sensor position that is not right
ALIKE = 0.9  # a second, different place worth this much of the best makes both worthless
TOLERANCE_EDGES = 3.0  # of matched key points
APART_EDGES = 6.0
SCREENED = 400  # points of a frame by which proposals are compared before ICP
REFINED = 4  # proposals that ICP refines
PARTNERS = 8  # placed frames against which one without a place is searched in each round
LOOP_ROUNDS = 3
HELD_EDGES = 0.1  # standard deviation up to which surface holds a link
SEEN_THROUGH = "surface of one would stand where the other's station looked through"
ELSEWHERE = "a different place fits as well (the surfaces repeat or are symmetric)"
CREASES = "creases alone hold one on the other, and no third frame confirms it"
OTHER_PLACE = "contradicts the other links"


@dataclass(frozen=True, eq=False, kw_only=True)
class Link(Value):
    """What was tried between two frames. `reason` is empty where the link was used, else says why not."""

    target: int
    source: int
    T_target_source: FloatArray
    quality: Quality
    how: str
    reason: str

    @property
    def used(self) -> bool:
        return not self.reason


@dataclass(frozen=True, eq=False, kw_only=True)
class Registered(Value):
    """T_world_frame : (n, 4, 4), nan where not placed.   covariance : (n, 6, 6) about the centre of each frame.   reasons : why one is not placed."""

    T_world_frame: FloatArray
    placed: BoolArray
    covariance: FloatArray
    links: tuple[Link, ...]
    reasons: tuple[str, ...]
    inflation: float


class Matcher:
    """Trees and features of the frames, made once each when first needed. Never leaves `register`."""

    def __init__(self, surfaces: Sequence[Surface], seed: int) -> None:
        self.surfaces, self.seed = surfaces, seed
        self._trees: dict[int, NearTree] = {}
        self._features: dict[int, Features] = {}
        self.guesses: dict[tuple[int, int], list[Link]] = {}  # of each pair, what can be used

    def tree(self, k: int) -> NearTree:
        if k not in self._trees:
            self._trees[k] = self.surfaces[k].tree()
        return self._trees[k]

    def features(self, k: int) -> Features:
        if k not in self._features:
            self._features[k] = features(self.surfaces[k])
        return self._features[k]

    def refine(self, target: int, source: int, T_start: FloatArray, how: str) -> Link:
        """The link that ICP finds from a start."""
        a, b = self.surfaces[target], self.surfaces[source]
        found = icp(b, a, self.tree(target), T_start)
        quality = judge(b, a, self.tree(target), found.T_target_source)
        reason = why_not(quality, found.converged)
        if not reason and sees_through(a, b, found.T_target_source):
            reason = SEEN_THROUGH
        link = Link(target=target, source=source, T_target_source=found.T_target_source, quality=quality, how=how, reason=reason)
        if link.used and self.both_seen(target, source):
            self.guesses.setdefault((target, source), []).append(link)
        return link

    def lies(self, target: int, source: int, T_target_source: FloatArray) -> bool:
        """True where two frames can lie like that, whatever motions it leaves open."""
        a, b = self.surfaces[target], self.surfaces[source]
        quality = judge(b, a, self.tree(target), T_target_source)
        return quality.overlap >= LEAST_OVERLAP and quality.consistency >= SEEN_CONSISTENCY and not quality.blocked > MOST_BLOCKED

    def both_seen(self, a: int, b: int) -> bool:
        """True where the stations of both frames are known."""
        return self.surfaces[a].view is not None and self.surfaces[b].view is not None

    def search(self, target: int, source: int, options: RansacOptions = RansacOptions()) -> Link | None:
        """The best link without a start; None where the features propose none."""
        edge = self.surfaces[target].edge_m
        proposals = propose(
            self.features(source), self.features(target), TOLERANCE_EDGES * edge, APART_EDGES * edge, options, self.seed + 7919 * target + source
        )
        links = [self.refine(target, source, p.T_target_source, "search") for p in self._screened(target, source, proposals)]
        best = max(links, key=lambda link: (link.used, score(link)), default=None)
        # where both stations are known, what a third frame sees decides between them (`worlds`)
        if best is not None and best.used and not self.both_seen(target, source) and any(self._rivals(best, link) for link in links):
            return replace(best, reason=ELSEWHERE)
        return best

    def _rivals(self, best: Link, other: Link) -> bool:
        """True where two links put the source at different places and are worth the same."""
        if not other.used or score(other) < ALIKE * score(best):
            return False
        moved = self.surfaces[best.source].points
        offset = applied(best.T_target_source, moved) - applied(other.T_target_source, moved)
        return float(np.sqrt((offset**2).sum(axis=1).mean())) > TOLERANCE_EDGES * self.surfaces[best.target].edge_m

    def _screened(self, target: int, source: int, proposals: Sequence[Proposal]) -> list[Proposal]:
        """The proposals under which most points of a draw come to lie by the other surface."""
        if len(proposals) <= REFINED:
            return list(proposals)
        b, a = self.surfaces[source], self.surfaces[target]
        rows = sampled_rows(len(b), SCREENED, self.seed)
        few = b.few(rows)
        reach = 2.0 * a.edge_m
        count = [len(pairs_of(few, a, self.tree(target), p.T_target_source, reach).across_m) for p in proposals]
        return [proposals[k] for k in np.argsort([-c for c in count], kind="stable")[:REFINED]]


def score(link: Link) -> float:
    """How much a link is worth: what it explains, times how little it contradicts."""
    return link.quality.overlap * link.quality.consistency**2


def why_not(quality: Quality, converged: bool) -> str:
    """Empty where a link can be used."""
    if not np.isfinite(quality.residual_m):
        return "the two frames do not overlap"
    if quality.overlap < LEAST_OVERLAP:
        return f"the two frames share {quality.overlap:.0%} of the smaller one's surface; {LEAST_OVERLAP:.0%} is needed"
    needed = SEEN_CONSISTENCY if np.isfinite(quality.blocked) else LEAST_CONSISTENCY
    if quality.consistency < needed:
        return f"of what comes to lie close together only {quality.consistency:.0%} is one surface; {needed:.0%} is needed"
    if quality.blocked > MOST_BLOCKED:
        return f"{quality.blocked:.0%} of the points would stand in the way of the other station's rays; {MOST_BLOCKED:.0%} is allowed"
    if quality.is_degenerate:
        return f"the shared surface leaves {len(quality.open_directions)} of 6 motions open ({motions(quality)})"
    return "" if converged else "the refinement does not settle"


def is_sure(quality: Quality) -> bool:
    """True where most of the smaller frame lies on the other, and little that is near does not."""
    return quality.consistency >= SURE_CONSISTENCY and quality.overlap >= SURE_OVERLAP


def motions(quality: Quality) -> str:
    # the directions of one open space may be any of it: what turns is the rank of their rotations, not each one's share
    turns = int((np.linalg.svd(quality.open_directions[:, :3], compute_uv=False) > 0.5).sum())
    slides = len(quality.open_directions) - turns
    said = [f"it slides in {slides} direction{'s' if slides > 1 else ''}"] if slides else []
    return ", ".join(said + ([f"it turns about {turns} {'axes' if turns > 1 else 'axis'}"] if turns else []))


def register(surfaces: Sequence[Surface], T_start: Sequence[FloatArray | None], held: Sequence[int] = (), seed: int = 0) -> Registered:
    """Poses of the frames.

    surfaces : of one voxel edge, each in its own frame.   T_start : where a frame is believed to be, None: not known.   held : frames that stay
    there; the world is theirs. Without any, it is that of the first frame of the largest group that hangs together.
    Frames that are small (`Surface.is_small`) must be held or are not placed.
    """
    n = len(surfaces)
    matcher = Matcher(surfaces, seed)
    usable = [k for k in range(n) if not surfaces[k].is_small]
    tried: dict[tuple[int, int], Link] = {}
    for target, source in _pairs(usable, set(held)):
        link = _link(matcher, target, source, T_start)
        if link is not None:
            tried[target, source] = link
    tolerance = 4.0 * max((s.edge_m for s in surfaces), default=0.0)
    arranger = Arranger(surfaces, tolerance)
    result: GraphResult | None = None
    poses: dict[int, FloatArray] = {}
    for round_ in range(LOOP_ROUNDS + 1):
        tried = _possible(matcher, arranger, tried, T_start, held)
        poses, result, tried = _consistent(surfaces, tried, T_start, held, tolerance)
        if round_ == LOOP_ROUNDS:
            break
        found = _loops(matcher, tried, poses, usable, set(held))
        if not (_stragglers(matcher, tried, poses, usable, set(held), tolerance) or found):
            break
    return _registered(surfaces, tried, poses, result)


def _pairs(usable: Sequence[int], held: set[int]) -> list[tuple[int, int]]:
    """(target, source) to be tried first: every pair of few frames, neighbours in order of many; never two that are held."""
    reach = len(usable) if len(usable) <= ALL_PAIRS else NEIGHBOURS
    pairs = [(usable[i], usable[j]) for j in range(len(usable)) for i in range(max(0, j - reach), j)]
    return [(a, b) for a, b in pairs if not (a in held and b in held)]


def _link(matcher: Matcher, target: int, source: int, T_start: Sequence[FloatArray | None]) -> Link | None:
    a, b = T_start[target], T_start[source]
    near = None
    if a is not None and b is not None:
        near = matcher.refine(target, source, inverse(a) @ b, "start")
        if near.used and is_sure(near.quality):
            return near
    found = matcher.search(target, source)
    return max([k for k in (near, found) if k is not None], key=lambda k: (k.used, score(k)), default=None)


def _possible(
    matcher: Matcher, arranger: Arranger, tried: dict[tuple[int, int], Link], T_start: Sequence[FloatArray | None], held: Sequence[int]
) -> dict[tuple[int, int], Link]:
    """The links of the largest arrangement in which no station sees through what another saw; the others get their reason.

    Links of frames whose stations are not known are left as they are, and so are all where none is.
    """
    if not matcher.guesses:
        return tried
    links = [link for own in matcher.guesses.values() for link in own]
    links += [link for pair, link in tried.items() if link.used and pair not in matcher.guesses]
    guesses = [Guess(target=k.target, source=k.source, T_target_source=k.T_target_source, score=score(k)) for k in links]
    roots = {k: T for k in held if (T := T_start[k]) is not None}
    worlds = arranger.worlds(roots, guesses)
    fresh = dict(tried)
    if not worlds:
        return fresh
    best = worlds[0].poses
    doubtful = arranger.elsewhere(worlds[0], worlds[1:], set(held)) | arranger.turned(worlds[0], matcher.lies, set(held))
    for pair in {(k.target, k.source) for k in links}:
        own = [k for k in links if (k.target, k.source) == pair]
        known = best.keys() >= set(pair)
        inside = [k for k in own if known and not arranger.apart(k.source, best[k.target] @ k.T_target_source, best[k.source])]
        if inside and not doubtful.intersection(pair):
            fresh[pair] = max(inside, key=score)
            if len(best) == 2 and not held and fresh[pair].quality.std_m > HELD_EDGES * matcher.surfaces[pair[0]].edge_m:
                fresh[pair] = replace(fresh[pair], reason=CREASES)  # nor is there a third frame that could contradict
        else:
            why = ELSEWHERE if doubtful.intersection(pair) else SEEN_THROUGH if worlds[0].refused.intersection(pair) else OTHER_PLACE
            fresh[pair] = replace(max(own, key=score), reason=why)
    return fresh


def _consistent(
    surfaces: Sequence[Surface], tried: dict[tuple[int, int], Link], T_start: Sequence[FloatArray | None], held: Sequence[int], tolerance: float
) -> tuple[dict[int, FloatArray], GraphResult | None, dict[tuple[int, int], Link]]:
    """Poses from the links that hold together; the others get their reason."""
    n = len(surfaces)
    used = {pair: link for pair, link in tried.items() if link.used}
    closed = triangles_closed({pair: link.T_target_source for pair, link in used.items()}, _size(surfaces), tolerance)
    ordered = sorted(used, key=lambda pair: (-closed[pair] * score(used[pair]) - score(used[pair]), pair))
    roots: dict[int, FloatArray] = {k: T for k in held if (T := T_start[k]) is not None}
    if not roots:
        label = components(n, list(used))
        largest = max(sorted(set(label)), key=lambda c: sum(len(surfaces[k]) for k in range(n) if label[k] == c and _linked(k, used)), default=0)
        if used:
            roots = {min(k for k in range(n) if label[k] == largest): np.eye(4)}
    pairs = np.array(ordered, np.int64).reshape(-1, 2)
    T = np.array([used[p].T_target_source for p in ordered]).reshape(-1, 4, 4)
    poses = along_tree(n, pairs, T, range(len(ordered)), roots)
    kept = [p for p in ordered if p[0] in poses and p[1] in poses]
    if not kept:
        return poses, None, tried
    order = sorted(poses)
    at = {k: i for i, k in enumerate(order)}
    links = [
        GraphLink(
            target=at[p[0]],
            source=at[p[1]],
            T_target_source=used[p].T_target_source,
            centre=used[p].quality.centre,
            information=used[p].quality.information,
        )
        for p in kept
    ]
    about = np.array([surfaces[k].points.mean(axis=0) if len(surfaces[k]) else np.zeros(3) for k in order])
    result = optimise(np.array([poses[k] for k in order]), links, [at[k] for k in roots], about)
    fresh = dict(tried)
    for p, weight in zip(kept, result.weight.tolist(), strict=True):
        off = discrepancy(used[p], result.T_world_frame[at[p[0]]], result.T_world_frame[at[p[1]]])
        if weight < GraphOptions().reject_below and off > surfaces[p[0]].edge_m:
            fresh[p] = replace(used[p], reason=OTHER_PLACE)
    if any(not fresh[p].used for p in kept):  # what contradicts must not carry a frame on its own
        return _consistent(surfaces, fresh, T_start, held, tolerance)
    links = [replace(link, information=used[p].quality.told) for link, p in zip(links, kept, strict=True)]
    result = optimise(result.T_world_frame, links, [at[k] for k in roots], about)
    return {k: result.T_world_frame[at[k]] for k in order}, result, fresh


def discrepancy(link: Link, T_world_target: FloatArray, T_world_source: FloatArray) -> float:
    """How far the link would have the matched points lie from where the poses put them, m (rms over a body of their size)."""
    off = inverse(T_world_target) @ T_world_source @ inverse(link.T_target_source)
    centre = link.quality.centre
    shift = off[:3, :3] @ centre + off[:3, 3] - centre
    return float(np.hypot(np.linalg.norm(shift), link.quality.size_m * np.linalg.norm(rotation_vector(off[:3, :3]))))


def _linked(k: int, used: dict[tuple[int, int], Link]) -> bool:
    return any(k in pair for pair in used)


def _loops(matcher: Matcher, tried: dict[tuple[int, int], Link], poses: dict[int, FloatArray], usable: Sequence[int], held: set[int]) -> bool:
    """Links between frames that the poses bring together but that have none yet; True where one was found."""
    found = False
    placed = [k for k in usable if k in poses]
    for y, source in enumerate(placed):
        for target in placed[:y]:
            pair = (target, source)
            if (target in held and source in held) or (pair in tried and (tried[pair].used or tried[pair].how == "loop")):
                continue
            T = inverse(poses[target]) @ poses[source]
            if not may_overlap(matcher.surfaces[target], matcher.surfaces[source], T):
                continue
            link = matcher.refine(target, source, T, "loop")
            if link.used or pair not in tried:
                tried[pair] = link
            found |= link.used
    return found


def _stragglers(
    matcher: Matcher, tried: dict[tuple[int, int], Link], poses: dict[int, FloatArray], usable: Sequence[int], held: set[int], tolerance: float
) -> bool:
    """Search each frame that has no pose, or one that no closed triangle of links confirms, against those that have one, nearest in number first.

    True where a link was found.
    """
    found = False
    confirmed = _confirmed(matcher.surfaces, tried, tolerance) | held
    for k in [k for k in usable if k not in confirmed]:
        others = [
            j for j in sorted(poses, key=lambda j: (abs(j - k), j)) if j in usable and j != k and not _was_searched(tried.get((min(j, k), max(j, k))))
        ]
        new = 0
        for j in others[:PARTNERS]:
            pair = (min(j, k), max(j, k))
            link = matcher.search(*pair)
            if link is not None:
                tried[pair] = link
                new += link.used
            if new == (2 if k in poses else 1):  # two confirm each other
                break
        found |= new > 0
    return found


def _was_searched(link: Link | None) -> bool:
    """A link that was refined from a pose in doubt says nothing against the pair."""
    return link is not None and (link.used or link.how != "loop")


def _confirmed(surfaces: Sequence[Surface], tried: dict[tuple[int, int], Link], tolerance: float) -> set[int]:
    """Frames of a triangle of links that closes."""
    used = {pair: link.T_target_source for pair, link in tried.items() if link.used}
    return {k for pair, count in triangles_closed(used, _size(surfaces), tolerance).items() if count for k in pair}


def _size(surfaces: Sequence[Surface]) -> float:
    """A turn of one radian moves the points of a frame by about this, m."""
    return float(np.median([s.size_m() for s in surfaces if len(s)])) if any(len(s) for s in surfaces) else 1.0


def may_overlap(target: Surface, source: Surface, T: FloatArray) -> bool:
    """True where the box of the moved source meets that of the target."""
    moved = source.points @ T[:3, :3].T + T[:3, 3]
    margin = 3.0 * target.edge_m
    return bool((moved.min(axis=0) <= target.points.max(axis=0) + margin).all() and (moved.max(axis=0) >= target.points.min(axis=0) - margin).all())


def _registered(
    surfaces: Sequence[Surface], tried: dict[tuple[int, int], Link], poses: dict[int, FloatArray], result: GraphResult | None
) -> Registered:
    n = len(surfaces)
    T, covariance = np.full((n, 4, 4), np.nan), np.full((n, 6, 6), np.nan)
    for i, k in enumerate(sorted(poses)):
        T[k] = poses[k]
        covariance[k] = result.covariance[i] if result is not None else 0.0
    placed = np.array([k in poses for k in range(n)], bool)
    reasons = tuple("" if placed[k] else _why_left_out(k, surfaces[k], tried) for k in range(n))
    links = tuple(tried[p] for p in sorted(tried))
    return Registered(
        T_world_frame=T, placed=placed, covariance=covariance, links=links, reasons=reasons, inflation=result.inflation if result is not None else 1.0
    )


def _why_left_out(k: int, surface: Surface, tried: dict[tuple[int, int], Link]) -> str:
    if surface.is_small:
        return f"{len(surface)} voxels of {surface.edge_m:.3g} m have too little shape to be placed"
    own = [link for pair, link in tried.items() if k in pair]
    if not own:
        return "nothing in it resembles another frame; give its pose with --poses"
    best = max(own, key=lambda link: (link.used, link.quality.is_degenerate and link.quality.consistency >= LEAST_CONSISTENCY, score(link)))
    return f"{best.reason or 'it hangs together with a smaller group of frames only'}; give its pose with --poses"
