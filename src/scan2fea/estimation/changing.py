"""Members whose section changes along the axis: a taper, or a haunch at one end or at both.

slices (profile.py) -> points moved back to the least section -> its fit as of a prism -> growth and section together by scoring -> fit again -> test

Points are moved back to the least section by what it has grown at their height; the score of the growth is that of the place of the section, times
how far the piece a point lies on moves. Kinds are told apart by BIC on the same points, and a prism by the same.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError, InputError
from scan2fea.estimation.ends import rough_ends
from scan2fea.estimation.explain import TOLERANCE
from scan2fea.estimation.fit import SectionFit
from scan2fea.estimation.likelihood import Layout, SectionModel, bounds, hull_area, prior
from scan2fea.estimation.profile import RADIAL, Law, laws_of
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.estimation.uncertainty import covariance_of
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.kernel.stretch import CHANGING, Stretch, stretch_of
from scan2fea.types import FloatArray, Member, SectionChange, Value

Fit = Callable[[FloatArray, str], tuple[Member, SectionFit]]  # points and family ("": any) -> the prism that fits them

_POINTS = 12_000
_STEPS = 40
_ROUGH = 0.03  # of the growth: what slices are good to
_TRIED = 3  # laws that are fitted
_SHORTEST, _LONGEST = 0.05, 0.9  # of a haunch, in lengths of the member: shorter is an end plate, longer a taper
_MARGIN = 0.02  # of the length, at the ends


@dataclass(frozen=True, eq=False, kw_only=True)
class Changing(Value):
    """member : with its change.   bic, bic_prism : of the same points with and without.   significance : growth over its standard deviation."""

    member: Member
    section: SectionFit
    bic: float
    bic_prism: float
    significance: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Grown(Value):
    """A law fitted with the section. phi : growth of each end that grows and, of haunches, the height where it starts; covariance of (theta, phi)."""

    theta: FloatArray
    phi: FloatArray
    covariance: FloatArray
    bic: float
    dimension: str
    law: Law


def changing(points: FloatArray, member: Member, fit: Fit, seed: int = 0) -> Changing | None:
    """The member with a section that changes, where that explains (n, 3) points better than a prism does; None where it does not.

    member : the prism that was fitted.   fit : fits a prism.
    """
    local = _local(points, member.T_world_member)
    span = _inner(*rough_ends(local[:, 2]))
    laws = {axis: law for axis in (0, 1, RADIAL) for law in laws_of(local, span, axis)[:1] if _is_material(law, local)}
    order = sorted(laws, key=lambda axis: laws[axis].bic)
    if len(laws) == 3 and _alike(laws[0], laws[1]):
        order = [RADIAL, *(axis for axis in order if axis != RADIAL)]
    for law in (laws[axis] for axis in order[:2]):
        began = _attempt(fit, _unblended(local, span, law), member.T_world_member, "")
        if began is None:
            continue
        found = _settled(points, *began, fit, seed)
        if found is not None:
            return found
    return None


def _alike(a: Law, b: Law) -> bool:
    """Whether both widths grow by the same: then it is a circle."""
    most = float(a.growth_m.max()), float(b.growth_m.max())
    return min(most) > 0.8 * max(most)


def _is_material(law: Law, local: FloatArray) -> bool:
    """Whether the growth is beyond mill tolerance: of rolled shapes nobody wants to know it below."""
    size = float(np.linalg.norm(np.quantile(local[:, :2], 0.98, axis=0) - np.quantile(local[:, :2], 0.02, axis=0)))
    return float(law.growth_m.max()) > TOLERANCE * size


def _local(points: FloatArray, T: FloatArray) -> FloatArray:
    return np.asarray((points - T[:3, 3]) @ T[:3, :3])


def _inner(low: float, high: float) -> tuple[float, float]:
    return low + _MARGIN * (high - low), high - _MARGIN * (high - low)


def _unblended(local: FloatArray, span: tuple[float, float], law: Law) -> FloatArray:
    """(n, 3) points moved back by what their side has moved, as far as the middle half of the width: good enough to tell the family."""
    share = (local[:, 2] - span[0]) / (span[1] - span[0])
    low, high = (np.interp(share, law.share, side) for side in law.ends)
    out = local.copy()
    if law.axis == RADIAL:
        r = np.linalg.norm(local[:, :2], axis=1)
        out[:, :2] *= (1 - high / np.maximum(r, 1e-300))[:, None]
        return out
    u = local[:, law.axis]
    bottom, top = np.quantile(u - low, 0.04), np.quantile(u - high, 0.96)
    part = np.clip((u - low - bottom) / np.maximum(top + high - low - bottom, 1e-300), 0.25, 0.75) * 2 - 0.5
    out[:, law.axis] = u - (1 - part) * low - part * high
    return out


def _attempt(fit: Fit, local: FloatArray, T: FloatArray, family: str) -> tuple[Member, SectionFit] | None:
    try:
        return fit(local @ T[:3, :3].T + T[:3, 3], family)
    except (EstimationError, InputError, np.linalg.LinAlgError):
        return None


def _settled(points: FloatArray, member: Member, section: SectionFit, fit: Fit, seed: int) -> Changing | None:
    """Growth and section fitted together in the frame of the first fit, the prism again on the points moved back, and both once more."""
    member = _squared(points, member)
    grown = _best(points, member, section, seed)
    if grown is None:
        return None
    again = _attempt(fit, _undone(points, member, grown), member.T_world_member, member.family)
    if again is None or again[0].family != member.family:
        return None
    member, section = again
    final = _best(points, member, section, seed)
    if final is None:
        return None
    plain = _climbed(points, member, section, None, seed)
    made = _with_change(member, final)
    if made is None:
        return None
    told, significance = made
    return Changing(member=told, section=section, bic=final.bic, bic_prism=math.inf if plain is None else plain.bic, significance=significance)


def _squared(points: FloatArray, member: Member) -> Member:
    """The member in the frame about which its section grows: the middle of a centred dimension, else the corner, back or flange it starts from."""
    length = member.values()["length"]
    local, span = _local(points, member.T_world_member), _inner(0.0, length)
    T = member.T_world_member.copy()
    for dimension in CHANGING[member.family]:
        stretch = stretch_of(member.family, member.values(), dimension)
        law = next((law for law in laws_of(local, span, stretch.axis) if _is_material(law, local)), None)
        if law is None or stretch.axis == RADIAL:
            continue
        still = float(stretch.shift[0]), float(stretch.shift[-1])
        anchor = law.ends[0] if still[0] == 0 else law.ends[1] if still[1] == 0 else law.ends.mean(0)
        if law.kind == "haunch":
            least = int(np.argmin(law.growth_m))
            anchor = law.skew_m * (law.share - law.share[least])
        slope = float(anchor[-1] - anchor[0]) / (span[1] - span[0])
        u, z = T[:3, stretch.axis].copy(), T[:3, 2].copy()
        T[:3, 3] += (float(anchor[0]) - slope * span[0]) * u
        T[:3, 2] = (z + slope * u) / math.hypot(1.0, slope)
        T[:3, stretch.axis] = (u - slope * z) / math.hypot(1.0, slope)
    return dataclasses.replace(member, T_world_member=T, bow=np.zeros((2, 0)), twist=np.zeros(0))


def _best(points: FloatArray, member: Member, section: SectionFit, seed: int) -> _Grown | None:
    """The likeliest law of any dimension that may change."""
    local = sweep_of_member(dataclasses.replace(member, change=None)).coordinates(points)
    span = _inner(0.0, member.values()["length"])
    tried = []
    for dimension in CHANGING[member.family]:
        axis = RADIAL if member.family in ROUND else stretch_of(member.family, member.values(), dimension).axis
        tried += [(dimension, law) for law in laws_of(local, span, axis)[:_TRIED] if _is_material(law, local)]
        tapers = [(dimension, law) for law in laws_of(local, span, axis) if law.kind == "taper" and _is_material(law, local)]
        tried += [one for one in tapers if one not in tried]
    found = [_climbed(points, member, section, one, seed) for one in tried]
    return min((one for one in found if one is not None), key=lambda one: one.bic, default=None)


# ------------------------------------------------------------------ growth and section together


def _phi_of(law: Law, length: float) -> FloatArray:
    """Unknowns of a law: growth at the ends that grow, then heights where haunches start."""
    if law.kind == "taper":  # the slices end short of the ends
        return np.array([law.growth_m[-1] - law.growth_m[0]]) / (1 - 2 * _MARGIN)
    ends = _growing(law)
    return np.array([*(law.growth_m[0 if end == 0 else -1] for end in ends), *(length * law.share[1:-1])])


def _growing(law: Law) -> tuple[int, ...]:
    """Ends that grow: 0 and 1."""
    if len(law.share) == 4:
        return (0, 1)
    return (0,) if law.share[1] < 0.5 else (1,)


def _growth(law: Law, phi: FloatArray, z: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Growth (n,) at heights z, and its derivatives (n, q). A taper grows from nothing at its small end."""
    if law.kind == "taper":
        slope = np.clip(z / length, -0.1, 1.1)
        away = slope if phi[0] >= 0 else slope - 1
        return phi[0] * away, away[:, None]
    ends = _growing(law)
    total, by_size, by_start = np.zeros(len(z)), [], []
    for k, end in enumerate(ends):
        start = phi[len(ends) + k]
        reach, away = (start, z) if end == 0 else (length - start, length - z)
        hat = np.maximum(1 - away / reach, 0.0)
        total = total + phi[k] * hat
        by_size.append(hat)
        by_start.append(np.where(hat > 0, phi[k] * away / reach**2, 0.0) * (1 if end == 0 else -1))
    return total, np.stack([*by_size, *by_start], 1)


def _climbed(points: FloatArray, member: Member, section: SectionFit, what: tuple[str, Law] | None, seed: int) -> _Grown | None:
    """Section and growth of most likelihood, by damped scoring from the member's; `what` None: the section alone, as a prism."""
    values, length = member.values(), member.values()["length"]
    chosen = points[sampled_rows(len(points), _POINTS, seed)]
    local = sweep_of_member(dataclasses.replace(member, change=None)).coordinates(chosen)
    low, high = _inner(0.0, length)
    local = local[(local[:, 2] > low) & (local[:, 2] < high)]
    layout = Layout(family=member.family, tilt=True)
    theta = np.zeros(len(layout.names))
    theta[: layout.n_values] = [values[name] for name in PARAMETERS[member.family]]
    theta[layout.place["log_sigma"]] = section.layout.get(section.theta, "log_sigma")
    if what is not None:  # slices are good to some per cent: a start that is that blurred sees the right faces
        blurred = math.log(max(_ROUGH * float(what[1].growth_m.max()), section.sigma_m))
        theta[layout.place["log_sigma"]] = blurred
    theta[layout.place["logit_outliers"]] = section.layout.get(section.theta, "logit_outliers")
    law = None if what is None else what[1]
    phi = np.zeros(0) if law is None else _phi_of(law, length)
    weight = np.maximum(section.face_weight, 1e-3) if section.base_weight is not None or section.layout.free_faces else None
    area, q = hull_area(local[:, :2]), len(theta)
    size = float(np.ptp(local[:, :2], axis=0).max())
    lower, upper = bounds(layout, size)
    mean, sd = prior(layout)
    precision = np.r_[1 / np.square(sd), np.zeros(len(phi))]

    def evaluate(both: FloatArray) -> tuple[float, FloatArray]:
        t, p = both[:q], both[q:]
        if (t < lower).any() or (t > upper).any() or not _is_law(law, p, length):
            return -math.inf, np.zeros((len(local), len(both)))
        xy, slopes, moves = local[:, :2], np.zeros((len(local), 0)), np.zeros((len(local), 2))
        density = by_growth = np.zeros(len(local))
        if what is not None and law is not None:
            growth, slopes = _growth(law, p, local[:, 2], length)
            at = dict(zip(PARAMETERS[member.family], t[: layout.n_values].tolist(), strict=True))
            stretch = stretch_of(member.family, at, what[0], law.side)
            xy, density, by_growth = stretch.undone_with_density(xy, growth)
            moves = stretch.moves(xy)
        zeta = (2 * local[:, 2] - low - high) / (high - low)
        model = SectionModel(layout=layout, xy=xy, zeta=zeta, area_m2=area, noise=section.noise, face_weight=weight)
        logp, scores = model.evaluate(t)
        if what is not None:  # a piece that moves with the growth does to its points what the whole section does that moves as far
            by = moves[:, 0] * scores[:, layout.place["cx"]] + moves[:, 1] * scores[:, layout.place["cy"]] + by_growth
            scores = np.concatenate([scores, by[:, None] * slopes], 1)
        return float(logp.sum() + density.sum()) - 0.5 * float((((t - mean) / sd) ** 2)[np.isfinite(sd)].sum()), scores

    both = np.r_[np.clip(theta, lower, upper), phi]
    value, scores = evaluate(both)
    if not math.isfinite(value):
        return None
    damping = 1e-3
    for _ in range(_STEPS):
        information = scores.T @ scores + np.diag(precision)
        gradient = scores.sum(0) - precision * (both - np.r_[mean, np.zeros(len(phi))])
        unit = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        matrix = information * np.outer(unit, unit)
        step = unit * np.linalg.solve(matrix + damping * np.eye(len(unit)), unit * gradient)
        ahead, new = evaluate(both + step)
        if ahead >= value:
            gain, both, value, scores, damping = ahead - value, both + step, ahead, new, max(damping / 10, 1e-9)
            if gain < 0.01:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    information = scores.T @ scores + np.diag(precision)
    covariance = covariance_of(information, np.ones(len(both), bool))[0]
    bic = -2 * value + len(both) * math.log(len(local))
    dimension = "" if what is None else what[0]
    empty = Law(kind="", axis=0, share=np.zeros(0), growth_m=np.zeros(0), side=0, bic=0.0, ends=np.zeros((2, 0)))
    return _Grown(theta=both[:q], phi=both[q:], covariance=covariance, bic=bic, dimension=dimension, law=empty if law is None else law)


def _is_law(law: Law | None, phi: FloatArray, length: float) -> bool:
    if law is None or law.kind == "taper":
        return True
    n = len(phi) // 2
    starts = phi[n:]
    apart = len(starts) < 2 or starts[0] <= starts[1]
    reach = np.array([start if end == 0 else length - start for start, end in zip(starts, _growing(law), strict=True)])
    return bool((phi[:n] > 0).all() and (reach > _SHORTEST * length).all() and (reach < _LONGEST * length).all() and apart)


# ------------------------------------------------------------------ the member


def _undone(points: FloatArray, member: Member, grown: _Grown) -> FloatArray:
    """(n, 3) points in the straight frame of the member, moved back to the least section."""
    local = _local(points, member.T_world_member)
    growth = _growth(grown.law, grown.phi, np.clip(local[:, 2], 0.0, member.values()["length"]), member.values()["length"])[0]
    local[:, :2] = _stretch(member, grown).undone(local[:, :2], growth)
    return local


def _stretch(member: Member, grown: _Grown) -> Stretch:
    values = dict(zip(PARAMETERS[member.family], grown.theta[: len(PARAMETERS[member.family])].tolist(), strict=True))
    return stretch_of(member.family, values, grown.dimension, grown.law.side)


def _with_change(member: Member, grown: _Grown) -> tuple[Member, float] | None:
    """The member with its change, and the growth over its standard deviation; None where nothing grows."""
    length, names = member.values()["length"], PARAMETERS[member.family]
    if grown.law.kind == "taper":
        z = np.array([0.0, length])
    else:
        z = np.array([0.0, *sorted(grown.phi[len(grown.phi) // 2 :].tolist()), length])
    growth = _growth(grown.law, grown.phi, z, length)[0]
    slopes = _growth(grown.law, grown.phi, z, length)[1]
    row = names.index(grown.dimension)
    by = np.zeros((len(z), len(grown.covariance)))
    by[:, row] = 1.0
    by[:, len(grown.theta) :] = slopes
    spread = by @ grown.covariance @ by.T
    std = np.sqrt(np.maximum(np.diag(spread), 0.0))
    largest = int(np.argmax(growth))
    apart = by[largest].copy()
    apart[row] = 0.0
    growth_std = math.sqrt(max(float(apart @ grown.covariance @ apart), 0.0))
    if not growth.max() > 0 or not growth_std > 0:
        return None
    base = float(grown.theta[row])
    parameters, covariance = [], np.array(member.covariance, float)
    for k, p in enumerate(member.parameters):
        if p.name != grown.dimension or p.source == "fixed":
            parameters.append(p)
            continue
        least = float(std[int(np.argmin(growth))])
        wider = max(least, p.std_m or 0.0)
        if covariance[k, k] > 0:
            ratio = wider / math.sqrt(covariance[k, k])
            covariance[k] *= ratio
            covariance[:, k] *= ratio
        parameters.append(dataclasses.replace(p, value_m=base, std_m=wider if p.std_m is not None else None))
    change = SectionChange(
        kind=grown.law.kind, dimension=grown.dimension, z_m=z, value_m=base + growth, std_m=std, side=grown.law.side
    )
    told = dataclasses.replace(member, parameters=tuple(parameters), covariance=covariance, change=change)
    return told, float(growth[largest]) / growth_std


def is_better(found: Changing, n_points: int) -> bool:
    """Whether the change is one: likelier than a prism by BIC, and beyond chance and mill tolerance."""
    change = found.member.change
    if change is None:
        return False
    grown = float(np.ptp(change.value_m))
    size = max(v for name, v in found.member.values().items() if name != "length")
    return found.bic < found.bic_prism and found.significance**2 > 2 * math.log(n_points) and grown > TOLERANCE * size

