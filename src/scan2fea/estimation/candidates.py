"""The search among families: starts, ridge restarts, faces that were not seen, laws of noise; each hypothesis with its BIC on the same points."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import EstimationError, require
from scan2fea.estimation.anneal import annealed, climbed, on_the_ridge, ridge_restarts, walls, with_walls
from scan2fea.estimation.face_weights import free_faces, seen_weights, set_price, snapped
from scan2fea.estimation.initial import Start, starts
from scan2fea.estimation.likelihood import Layout, SectionModel, StatedNoise, bounds, model_of, sigma_floor
from scan2fea.estimation.on_lines import sections_on_lines
from scan2fea.estimation.other_face import other_faces
from scan2fea.estimation.plausible import WEB_MEDIAN, implausible_price, slenderness_price, usual_wall
from scan2fea.estimation.scoring import Scored
from scan2fea.estimation.visible import likeliest_set, visible_sets
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors
from scan2fea.types import FloatArray, IntArray, Value

_FIRST_POINTS, _POINTS = 600, 3000
_MARGIN = 40.0  # BIC units on 600 points: families further behind never came back
_AT_LEAST = 3  # families that are looked at closely
_STARTS = 2  # of each
_DITHER = 1.5  # of the floor of sigma
_HIDDEN = 10.0  # BIC units that hidden faces must gain before every family is asked what it would hide
_RESOLVED = 4.0  # sigma: a box has the kurtosis of two Gaussian sheets 3.7 of their sigma apart; further apart are two sheets under any law of noise
_FLATTEST_TUBE = 4.0  # h / b: nine in ten rectangular tubes of sections.csv are at most 3; flatter is rather a plate
_STILL_IN = 100.0  # BIC units behind the best at which a hypothesis is dropped: no law of noise or trimming of the ends brought one back from there
_STRAYS = 0.01  # of the points, off the best section: more than few strays, and the section may be another one
_RISE = 10  # steps on the first points before sections on lines are compared: a wall off by a sigma outweighs a face that nothing explains
_WALLS = 4  # of a tube: each may be turned once
_VERY_STRONG = 10.0  # BIC units (Kass and Raftery 1995)
_LAW_PRICE = _VERY_STRONG  # that a law other than Gauss's must gain
_LAWS_APART = 2 * math.log(math.pi * math.e / 6)  # BIC units a point: twice what Gauss's law says less than the box of its variance, in the plane


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate(Value):
    """One hypothesis at its optimum. face_weight : (f,) or None (all faces alike).

    bic : on the points that all candidates share, with `price` for what was chosen besides the unknowns.
    """

    layout: Layout
    theta: FloatArray
    noise: str
    face_weight: FloatArray | None
    log_likelihood: float
    bic: float
    price: float

    @property
    def family(self) -> str:
        return self.layout.family


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Value):
    """What every hypothesis is compared on. first, points : (n, 3) some hundreds and some thousands of the points."""

    first: FloatArray
    points: FloatArray
    z_range: tuple[float, float]
    area_m2: float
    size_m: float
    fixed: Mapping[str, float]
    stated: StatedNoise | None = None

    def model(self, layout: Layout, noise: str, face_weight: FloatArray | None, *, few: bool = False) -> SectionModel:
        chosen = self.first if few else self.points
        return model_of(chosen, layout, self.z_range, area_m2=self.area_m2, noise=noise, face_weight=face_weight, stated=self.stated)

    def held(self, layout: Layout) -> Mapping[str, float]:
        return {name: value for name, value in self.fixed.items() if name in layout.place}


def scene_of(
    points: FloatArray,
    rows: IntArray,
    z_range: tuple[float, float],
    area_m2: float,
    size_m: float,
    fixed: Mapping[str, float],
    seed: int,
    stated: StatedNoise | None = None,
) -> Scene:
    """A draw of these rows of the points, dithered by a noise just above the likelihood's floor.

    Exact points have no scores across their faces, so the sum of the scores' products would not tell how sharp the optimum is.
    """
    chosen = points[rows[sampled_rows(len(rows), _POINTS, seed)]]
    chosen = chosen + np.random.default_rng(seed).normal(0, _DITHER * sigma_floor(size_m), chosen.shape) * [1, 1, 0]
    first = chosen[sampled_rows(len(chosen), _FIRST_POINTS, seed + 1)]
    return Scene(first=first, points=chosen, z_range=z_range, area_m2=area_m2, size_m=size_m, fixed=fixed, stated=stated)


def search(scene: Scene, families: Sequence[str], *, may_hide: bool = True, seed: int = 0, begun: Sequence[Start] = ()) -> list[Candidate]:
    """Candidates with Gaussian noise, the best of each family and way of seeing it, best first. begun : where to start; empty: found here."""
    begun = [start for start in begun if start.layout.family in families] or starts(scene.first, families, scene.z_range, scene.area_m2, seed)
    risen = _risen(scene, begun) if begun else {}
    require(len(risen) > 0, EstimationError, f"no section of {', '.join(families)} begins to fit the points")  # or none with a likelihood
    found = [_settled(scene, Layout(family=family), tried) for family, tried in risen.items()]
    best = min(found, key=lambda c: c.bic)
    solid = _solid_of(scene, best)
    found += [solid] if solid is not None and solid.family in families else []
    if may_hide:
        plain = min(found, key=lambda c: c.bic)
        found += _tube_of(scene, plain, families)
        limit = plain.bic + _MARGIN * len(scene.points) / len(scene.first)
        explored = [c for c in found if c.bic <= limit or c is solid]
        for candidate in explored:
            found += hidden_faces(scene, candidate)
        if min(c.bic for c in found) < plain.bic - _HIDDEN or _unresolved(plain):
            for candidate in _half_seen(scene, begun, {c.family for c in explored}):
                found += hidden_faces(scene, candidate)
        found += _on_lines(scene, min(found, key=lambda c: c.bic), families)
        best = min(found, key=lambda c: c.bic)  # beside another family the likeness of a bar that lost would only count it twice
        found += _tube_of(scene, best, families) if best is not plain else []
    return sorted(found, key=lambda c: c.bic)


def _on_lines(scene: Scene, best: Candidate, families: Sequence[str]) -> list[Candidate]:
    """Sections on the lines of the points, where the best so far leaves many off: a wall may have closed up on the way to it."""
    if best.family in ROUND or best.layout.outlier_share(best.theta) < _STRAYS:
        return []
    roll, sigma = best.layout.get(best.theta, "roll"), best.layout.sigma(best.theta)
    found: list[Candidate] = []
    for family in families:
        layout, tried = Layout(family=family), []
        held = scene.held(layout)
        for values, turn, place in sections_on_lines(scene.points[:, :2], family, roll, sigma):
            theta = np.array([*values, turn, *place, math.log(sigma), math.log(_STRAYS)])
            weight = np.maximum(snapped(seen_weights(scene.model(layout, "gaussian", None, few=True), theta)), 1e-3)
            tried.append(climbed(scene.model(layout, "gaussian", weight, few=True), theta, scene.size_m, fixed=held, max_iterations=_RISE))
        if tried:
            theta = max(tried, key=lambda one: one.log_posterior).theta
            start = replace(best, layout=layout, theta=theta, noise="gaussian", face_weight=None, bic=math.inf)
            found += _hidden_from(scene, start)
    return found


def _unresolved(candidate: Candidate, sigmas: float = 0.5) -> bool:
    """Whether a wall is thinner than so many sigma: then a solid or a section with fewer walls, partly seen, may look the same."""
    thinnest = min((candidate.layout.get(candidate.theta, wall) for wall in walls(candidate.family)), default=math.inf)
    return thinnest < sigmas * candidate.layout.sigma(candidate.theta)


def _half_seen(scene: Scene, begun: Sequence[Start], done: set[str]) -> list[Candidate]:
    """Families that all their faces did not explain, each at the start where some of them explain the first points best."""
    found: list[Candidate] = []
    for family in dict.fromkeys(s.layout.family for s in begun):
        if family in done:
            continue
        tried = []
        for start in [s for s in begun if s.layout.family == family][:_STARTS]:
            model = scene.model(start.layout, "gaussian", None, few=True)
            weight = np.maximum(snapped(seen_weights(model, start.theta)), 1e-3)
            model = scene.model(start.layout, "gaussian", weight, few=True)
            tried += ridge_restarts(model, start.theta, scene.size_m, fixed=scene.held(start.layout), max_iterations=10)[:1]
        best = max(tried, key=lambda t: t.log_posterior)
        layout = Layout(family=family)
        found.append(candidate_of(scene, scene.model(layout, "gaussian", None), best))
    return found


def _risen(scene: Scene, begun: Sequence[Start]) -> dict[str, list[Scored]]:
    """Per family that may still win on the first points: its optima there, the best first. At least three families are looked at."""
    by_family: dict[str, list[Start]] = {}
    for start in begun:
        by_family.setdefault(start.layout.family, []).append(start)
    order = sorted(by_family, key=lambda f: by_family[f][0].bic)
    leader = by_family[order[0]][0].bic
    found: dict[str, list[Scored]] = {}
    for rank, family in enumerate(order):
        is_close = by_family[family][0].bic < leader + _MARGIN
        if not is_close and rank >= _AT_LEAST:
            break
        layout = by_family[family][0].layout
        few = scene.model(layout, "gaussian", None, few=True)
        tried: list[Scored] = []
        for start in by_family[family][: _STARTS if is_close else 1]:
            if is_close:
                tried += ridge_restarts(few, start.theta, scene.size_m, fixed=scene.held(layout))[:2]
            else:
                tried.append(annealed(few, start.theta, scene.size_m, fixed=scene.held(layout), max_iterations=10, tolerance=0.1))
        found[family] = sorted(tried, key=lambda s: -s.log_posterior)
    bic = {f: len(tried[0].theta) * math.log(len(scene.first)) - 2 * tried[0].log_posterior for f, tried in found.items()}
    return {family: tried for family, tried in found.items() if bic[family] < min(bic.values()) + _MARGIN}


def _settled(scene: Scene, layout: Layout, tried: Sequence[Scored]) -> Candidate:
    """The better of the two best optima of the first points, on all points of the scene."""
    model = scene.model(layout, "gaussian", None)
    done = max((annealed(model, s.theta, scene.size_m, fixed=scene.held(layout)) for s in tried[:2]), key=lambda s: s.log_posterior)
    return candidate_of(scene, model, done)


def _solid_of(scene: Scene, best: Candidate) -> Candidate | None:
    """The bar that fills the outline of the best section: a section whose walls have closed up is one, with fewer unknowns."""
    solid = {"CHS": "round", "round": None, "rect": None}.get(best.family, "rect")
    if solid is None:
        return None
    layout, old = Layout(family=solid), best.layout
    theta = np.array([old.get(best.theta, name) for name in layout.names])
    if solid == "rect":
        corners = np.concatenate([factors @ old.values(best.theta) for factors in corner_factors(old.family)])
        low, high = corners.min(0), corners.max(0)
        roll = old.get(best.theta, "roll")
        c, s = math.cos(roll), math.sin(roll)
        middle = np.array([[c, -s], [s, c]]) @ ((low + high) / 2)
        theta[[layout.place[name] for name in ("b", "t", "cx", "cy")]] = [*(high - low), *(theta[[layout.place["cx"], layout.place["cy"]]] + middle)]
    model = scene.model(layout, best.noise, None)
    return candidate_of(scene, model, annealed(model, theta, scene.size_m, fixed=scene.held(layout)))


def _tube_of(scene: Scene, bar: Candidate, families: Sequence[str]) -> list[Candidate]:
    """The tube that looks like a bar from outside, its wall a usual one: no point tells of it, and as many tubes as bars are seen that way."""
    tube, old = {"round": "CHS", "rect": "RHS"}.get(bar.family, ""), bar.layout
    outer = old.values(bar.theta)
    if tube not in families or outer.max() > _FLATTEST_TUBE * outer.min():
        return []
    layout = Layout(family=tube)
    theta = np.array([old.get(bar.theta, name) for name in layout.names])
    if tube == "RHS":
        theta[layout.place["h"]] = old.get(bar.theta, "t")
    wall = usual_wall(outer)
    theta[layout.place["t"]] = wall
    weight = _of_outside(scene, tube, bar)
    model = scene.model(layout, bar.noise, weight)
    done = climbed(model, theta, scene.size_m, fixed={**scene.held(layout), "t": wall})
    return [candidate_of(scene, model, done, bar.price + len(old.free_faces) * math.log(len(scene.points)) + 2 * math.log(2))]


def _of_outside(scene: Scene, tube: str, bar: Candidate) -> FloatArray:
    """(f,) weights of a tube's faces where its outer ones are those of the bar and no inner one was seen; what the bar had to choose is its price."""
    seen = scene.model(bar.layout, bar.noise, bar.face_weight).weights(bar.theta)
    outer = dict.fromkeys(faces(bar.family), 1.0) if seen is None else dict(zip(faces(bar.family), (seen / seen.max()).tolist(), strict=True))
    return np.array([0.0 if name.endswith("INNER") else outer.get(name.removesuffix("_OUTER"), 1.0) for name in faces(tube)])


def _outer_only(family: str, weight: FloatArray) -> bool:
    """Whether these are the weights of a tube of which no inner face was seen."""
    return family in ("RHS", "CHS") and not any(w > 0 for name, w in zip(faces(family), weight, strict=True) if name.endswith("INNER"))


def candidate_of(scene: Scene, model: SectionModel, done: Scored, price: float = 0.0) -> Candidate:
    """A hypothesis at its optimum; unknowns that the points do not depend on (the wall of a tube seen from outside) cost nothing."""
    lower, upper = bounds(model.layout, scene.size_m, scene.held(model.layout))
    n_free = int(((lower < upper) & (np.diag(done.information) > 0)).sum())
    informed = [wall for wall in walls(model.layout.family) if done.information[model.layout.place[wall], model.layout.place[wall]] > 0]
    values = dict(zip(PARAMETERS[model.layout.family], model.layout.values(done.theta).tolist(), strict=True))
    odd = slenderness_price(model.layout, done.theta, informed) + implausible_price(model.layout.family, values)
    bic = -2 * done.log_posterior + n_free * math.log(len(model.xy)) + price + odd
    return Candidate(
        layout=model.layout,
        theta=done.theta,
        noise=model.noise,
        face_weight=model.face_weight,
        log_likelihood=done.log_likelihood,
        bic=bic,
        price=price,
    )


def hidden_faces(scene: Scene, candidate: Candidate) -> list[Candidate]:
    """The same family with faces unseen: as a set of whole faces, and with every face's density free."""
    if len(faces(candidate.family)) < 2:
        return []
    found = _hidden_from(scene, candidate)
    limit = min(c.bic for c in found) - _VERY_STRONG
    opened = [c for theta in _opened(candidate.layout, candidate.theta) for c in _hidden_from(scene, replace(candidate, theta=theta))]
    found += [c for c in opened if c.bic < limit]
    for _ in range(_WALLS if candidate.family == "RHS" else 0):
        best = min(found, key=lambda c: c.bic)
        theta, limit = best.theta[: len(candidate.theta)], best.bic - _VERY_STRONG  # the weights of its faces come last
        seen = snapped(seen_weights(scene.model(candidate.layout, candidate.noise, None), theta)) > 0.0
        turned = [c for other in other_faces(candidate.layout, theta, seen) for c in _hidden_from(scene, replace(candidate, theta=other))]
        better = [c for c in turned if c.bic < limit]
        if not better:
            break
        found += better
    return found


def _opened(layout: Layout, theta: FloatArray) -> list[FloatArray]:
    """Where the web between two halves has closed up one of its faces may not have been seen: a usual web on either side of the other one."""
    if layout.family not in ("I", "T") or layout.get(theta, "tw") > 0.5 * layout.sigma(theta):
        return []
    web, roll = WEB_MEDIAN * layout.get(theta, "tf"), layout.get(theta, "roll")
    found = []
    for side in (-0.5, 0.5):
        other = with_walls(layout, theta, {"tw": web})
        other[layout.place["b"]] = max(other[layout.place["b"]] - web, 2 * web)  # the toes stay where they were seen
        other[layout.place["cx"]] += side * web * math.cos(roll)
        other[layout.place["cy"]] += side * web * math.sin(roll)
        found.append(other)
    return found


def _hidden_from(scene: Scene, candidate: Candidate) -> list[Candidate]:
    """As `hidden_faces`, from the unknowns of the candidate alone."""
    plain = candidate.layout
    names = faces(plain.family)
    held = scene.held(plain)
    whole, price = _set_of(scene, candidate)
    found = []
    theta = candidate.theta
    if 0 < whole.sum() < len(whole) and not _outer_only(plain.family, whole):  # the tube from outside is `_tube_of` a bar
        done = annealed(scene.model(plain, candidate.noise, whole), theta, scene.size_m, fixed=held)
        found.append(candidate_of(scene, scene.model(plain, candidate.noise, whole), done, price))
        theta = done.theta if found[0].bic < candidate.bic else theta
    weight = np.maximum(seen_weights(scene.model(plain, candidate.noise, None), theta), 1e-3)
    layout = replace(plain, free_faces=free_faces(plain.family, weight))
    start = np.concatenate([theta, [math.log(weight[names.index(name)] / weight.max()) for name in layout.free_faces]])
    model = scene.model(layout, candidate.noise, None)
    found.append(candidate_of(scene, model, annealed(model, start, scene.size_m, fixed=held)))
    return found


def _set_of(scene: Scene, candidate: Candidate) -> tuple[FloatArray, float]:
    """(f,) 1 for the faces of the likeliest set that sensors can have seen, and its price; any other set where that explains far more."""
    layout, values = candidate.layout, candidate.layout.values(candidate.theta)
    model = scene.model(layout, candidate.noise, None)
    order = faces(layout.family)
    any_set = snapped(seen_weights(model, candidate.theta))
    own = tuple(name for name, seen in zip(order, any_set, strict=True) if seen)
    possible = visible_sets(layout.family, dict(zip(PARAMETERS[layout.family], values.tolist(), strict=True)))
    price = 2 * math.log(2 * len(possible))  # half of the belief is in a section that was seen whole
    if not own or own in possible:
        return any_set, price
    chosen = likeliest_set(model, candidate.theta, [*possible, own])
    if chosen.bic[-1] + set_price(layout.family) < chosen.bic[:-1].min() + price:
        return any_set, set_price(layout.family)
    best = possible[int(np.argmin(chosen.bic[:-1]))]
    return np.array([float(name in best) for name in order]), price


def near_again(scene: Scene, found: Sequence[Candidate]) -> list[Candidate]:
    """Candidates that may still win, on the points of another scene, best first."""
    limit = found[0].bic + _STILL_IN
    solid = solids_in_question(found, len(scene.points))
    return sorted((with_noise(scene, c, c.noise) for c in found if c.bic < limit or c in solid), key=lambda c: c.bic)


def solids_in_question(found: Sequence[Candidate], n_points: int) -> list[Candidate]:
    """The best bar of each family where the best hypothesis, first of `found`, has a wall within four sigma, and it is not farther behind on that
    many points than any law brings back.

    Under the wrong law of noise two faces of a thin wall stand for one face under wider noise: the bar is right only under a law not yet tried.
    """
    if not _unresolved(found[0], _RESOLVED):
        return []
    best = (next((c for c in found if c.family == family), None) for family in ("rect", "round"))
    return [c for c in best if c is not None and c.bic < found[0].bic + _STILL_IN + _LAWS_APART * n_points]


def with_noise(scene: Scene, candidate: Candidate, noise: str) -> Candidate:
    """The candidate under a law of noise, from its optimum."""
    model = scene.model(candidate.layout, noise, candidate.face_weight)
    held = scene.held(candidate.layout)
    done = climbed(model, candidate.theta, scene.size_m, fixed=held, tolerance=1e-2)
    if noise != candidate.noise and _unresolved(candidate, _RESOLVED):
        # wall and noise were traded against each other under the other law: another part of the ridge may be higher now
        begun = on_the_ridge(candidate.layout, done.theta, held)
        tried = [climbed(model, theta, scene.size_m, fixed=held, max_iterations=15, tolerance=1e-2) for theta in begun]
        done = max([done, *tried], key=lambda t: t.log_posterior)
    law = _LAW_PRICE * (float(noise != "gaussian") - float(candidate.noise != "gaussian"))
    return candidate_of(scene, model, done, candidate.price + law)


def with_likeliest_noise(scene: Scene, found: Sequence[Candidate], laws: tuple[str, ...]) -> tuple[list[Candidate], dict[str, Candidate]]:
    """Candidates under the law of noise that makes the best of them likeliest, best first; and that best one under every law."""
    best = found[0]
    if best.layout.sigma(best.theta) < 2 * _DITHER * sigma_floor(scene.size_m):  # exact points have no law of noise
        laws = (best.noise,)
    # a wrong law may make hidden faces look likely: the best hypothesis that saw the section whole has its say on the law
    whole = next((c for c in found if c.face_weight is None and not c.layout.free_faces), best)
    asked = list({id(c): c for c in (best, whole, *solids_in_question(found, len(scene.points)))}.values())
    trials = [{law: c if law == c.noise else with_noise(scene, c, law) for law in laws} for c in asked]
    tried = min(trials, key=lambda t: min(c.bic for c in t.values()))
    law = min(tried, key=lambda name: tried[name].bic)
    known = {id(c): t[law] for c, t in zip(asked, trials, strict=True)}
    near = [c for c in found if c.bic < best.bic + _STILL_IN or id(c) in known]
    chosen = [known[id(c)] if id(c) in known else c if c.noise == law else with_noise(scene, c, law) for c in near]
    chosen.sort(key=lambda c: c.bic)
    if chosen[0].family != tried[law].family:  # what is said of the laws is said of the section that was chosen
        tried = {name: chosen[0] if name == law else with_noise(scene, chosen[0], name) for name in laws}
    return chosen, tried


def posterior(candidates: Sequence[Candidate]) -> dict[str, float]:
    """Family -> posterior probability, from the BIC of its best hypothesis."""
    best: dict[str, float] = {}
    for c in candidates:
        best[c.family] = min(c.bic, best.get(c.family, math.inf))
    lowest = min(best.values())
    weight = {family: math.exp(-0.5 * min(bic - lowest, 1400)) for family, bic in best.items()}
    total = sum(weight.values())
    return {family: w / total for family, w in sorted(weight.items(), key=lambda item: -item[1])}
