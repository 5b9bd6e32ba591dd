"""How far the response of a member is known: the standard deviations of its dimensions carried on to mass, deflection, frequency and buckling load.

First order: slopes of the beam model times the covariance. And by drawing dimensions from it (seeded): skew answers, a thin wall to the third power,
show there. A dimension that the data do not tell counts with how far off it may be, drawn log-normally: it is often half of itself. Section
properties are taken from a quadratic in the logarithms of the dimensions, fitted to solved sections round the estimate.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from scan2fea.errors import Scan2FeaError, UsageError
from scan2fea.fea.beam import assemble_beams, frequencies, straight
from scan2fea.fea.beam_theory import buckling_loads, tip_under_force, tip_under_tension, tip_under_torque
from scan2fea.fea.near_beam import NearBeams
from scan2fea.fea.section_properties import SectionProperties, properties_of
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.types import FloatArray, Material, Member, RootFillet, Value

N_ELEMENTS = 12  # of the beam whose frequencies are found for each sample: the first three within 0.1 %
N_FREQUENCIES = 4
ROOT = "r"  # the radius of the root fillets, beside the dimensions
_STEP_SD, _LEAST_STEP = 1.0, 1e-3  # of the fit: one standard deviation, at least that share of a dimension
_MOST_STEP = 0.2  # of a dimension: a wall that is hardly known must not become negative


@dataclass(frozen=True, kw_only=True)
class Budget(Value):
    """of each figure: value, first_order_std, std (by samples, `_spread`; the first order without any).   n_samples : drawn and used.
    assumed : dimensions that the data do not tell; how far off they may be (`Parameter.spread_m`) counts like a standard deviation, where any of
    it is known.
    """

    value: Mapping[str, float]
    first_order_std: Mapping[str, float]
    std: Mapping[str, float]
    n_samples: int
    assumed: tuple[str, ...]


def beam_response(p: SectionProperties, material: Material, length_m: float, force_n: float, n_elements: int = N_ELEMENTS) -> dict[str, float]:
    """The figures of one member: by name, SI. Forces along the axes of the section at the centroid of the tip, torque force times 1 m."""
    matrices = assemble_beams(straight(length_m, p, material, n_elements))
    free = np.zeros(len(matrices.stiffness), bool)
    return _told(p, material, length_m, force_n, frequencies(matrices, free, 6 + N_FREQUENCIES)[0])


def _told(p: SectionProperties, material: Material, length_m: float, force_n: float, hertz: FloatArray) -> dict[str, float]:
    """The figures, with the free frequencies (6 + k,), Hz."""
    out = {
        "mass_kg": material.density_kg_m3 * p.area * length_m,
        "tension": tip_under_tension(p, material, length_m, force_n),
        "twist": tip_under_torque(p, material, length_m, force_n),
        "buckling_n": float(buckling_loads(p, material, length_m)[0]),
    }
    for k, name in enumerate("xy"):
        u, twist = tip_under_force(p, material, length_m, force_n * np.eye(2)[k])
        out |= {f"bend_{name}_x": float(u[0]), f"bend_{name}_y": float(u[1]), f"bend_{name}_twist": twist}
    return out | {f"f{k + 1}_hz": float(f) for k, f in enumerate(hertz[6:])}


def budget(member: Member, material: Material, force_n: float, n_samples: int, seed: int) -> Budget:
    """The response of a member with its standard deviations. Raises UsageError where its dimensions make no section."""
    names, n = [p.name for p in member.parameters], len(member.parameters)
    vague = np.array([0.0 if p.observable else p.spread_m or 0.0 for p in member.parameters])
    covariance = np.asarray(member.covariance, float) + np.diag(vague**2)
    centre = np.array([p.value_m for p in member.parameters])
    if member.root.std_m > 0:
        names, vague, centre = [*names, ROOT], np.r_[vague, 0.0], np.r_[centre, member.root.radius_m]
        covariance = np.pad(covariance, (0, 1))
        covariance[n, n] = member.root.std_m**2
    std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    held = {ROOT: member.root.radius_m, **dict(zip(names, centre.tolist(), strict=True))}
    model = _SectionModel(member.family, held, dict(zip(names, std.tolist(), strict=True)), member.root)
    length = names.index("length")

    def response(values: FloatArray) -> dict[str, float]:
        return beam_response(model(dict(zip(names, values.tolist(), strict=True))), material, float(values[length]), force_n)

    told = response(centre)
    first = _first_order(response, centre, covariance, std, told)
    drawn: list[dict[str, float]] = []
    if n_samples and std.any():
        near = NearBeams(model(held), material, float(centre[length]), N_ELEMENTS)

        def sampled(values: FloatArray) -> dict[str, float]:
            p, length_m = model(dict(zip(names, values.tolist(), strict=True))), float(values[length])
            return _told(p, material, length_m, force_n, near.frequencies(p, length_m, 6 + N_FREQUENCIES))

        drawn = _samples(sampled, _draws(centre, covariance, vague, n_samples, seed))
    spread = {name: _spread(np.array([row[name] for row in drawn]), long_tails=bool(vague.any())) for name in told} if len(drawn) > 1 else first
    assumed = tuple(p.name for p in member.parameters if p.source in ("catalogue", "estimate"))
    return Budget(value=told, first_order_std=first, std=spread, n_samples=len(drawn), assumed=assumed)


def _first_order(
    response: Callable[[FloatArray], dict[str, float]], centre: FloatArray, covariance: FloatArray, std: FloatArray, told: Mapping[str, float]
) -> dict[str, float]:
    slopes = np.zeros((len(told), len(centre)))
    for k in np.flatnonzero(std > 0).tolist():
        step = 0.3 * std[k] * np.eye(len(centre))[k]
        ahead, behind = response(centre + step), response(centre - step)
        slopes[:, k] = [(ahead[name] - behind[name]) / (0.6 * std[k]) for name in told]
    variance = np.einsum("rk,kl,rl->r", slopes, covariance, slopes)
    return {name: float(np.sqrt(max(v, 0.0))) for name, v in zip(told, variance, strict=True)}


def _draws(centre: FloatArray, covariance: FloatArray, vague: FloatArray, n: int, seed: int) -> FloatArray:
    """(n, p) dimensions drawn from their normal distribution; those whose spread is `vague` (p,) > 0 log-normally, by themselves."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    draws: FloatArray = centre + np.random.default_rng(seed).normal(size=(n, len(centre))) @ root.T
    for k in np.flatnonzero(vague).tolist():
        draws[:, k] = centre[k] * np.exp(np.sqrt(np.log1p((vague[k] / centre[k]) ** 2)) * (draws[:, k] - centre[k]) / vague[k])
    return draws


def _spread(drawn: FloatArray, *, long_tails: bool) -> float:
    """Standard deviation; with long tails half of what the middle 68 % of the draws span: a wall near nothing bends without end."""
    if not long_tails:
        return float(np.std(drawn, ddof=1))
    low, high = np.quantile(drawn, ndtr([-1.0, 1.0]))
    return float(high - low) / 2


def _samples(response: Callable[[FloatArray], dict[str, float]], draws: FloatArray) -> list[dict[str, float]]:
    """Responses of drawn dimensions; draws that make no section (a wall below nothing, or above the section) are left out."""
    out = []
    for row in draws:
        try:
            out.append(response(row))
        except (Scan2FeaError, np.linalg.LinAlgError):
            continue
    return out


class _SectionModel:
    """Section properties near an estimate: the logarithm of each, or its value where it may change sign, as a quadratic in the logarithms of the
    dimensions, through the exact figures at the estimate.
    """

    def __init__(self, family: str, values: Mapping[str, float], std: Mapping[str, float], root: RootFillet = RootFillet()) -> None:
        self._names = [name for name in (*PARAMETERS[family], ROOT) if std.get(name, 0.0) > 0]
        self._family, self._values = family, {name: values[name] for name in (*PARAMETERS[family], ROOT)}
        self._exact = properties_of(family, self._values, root)
        if not self._names:
            return
        step = [min(max(_STEP_SD * std[n] / values[n], _LEAST_STEP), _MOST_STEP) for n in self._names]
        offsets = _design(len(step)) * np.log1p(np.array(step))
        moved = [self._moved(x) for x in offsets]
        rows = [self._row(properties_of(family, values, replace(root, radius_m=values[ROOT]), level=0)) for values in moved]
        change = np.array(rows) - rows[0]
        self._factors = np.linalg.lstsq(_terms(offsets), change, rcond=None)[0]
        self._base = self._row(self._exact)

    def _moved(self, logs: FloatArray) -> dict[str, float]:
        return {**self._values, **{n: self._values[n] * float(np.exp(x)) for n, x in zip(self._names, logs, strict=True)}}

    @staticmethod
    def _row(p: SectionProperties) -> FloatArray:
        """Lengths in units of the root of the area, so that all entries are of size one."""
        unit = float(np.sqrt(p.area))
        tiny = 1e-12
        logs = [p.area, p.ixx, p.iyy, p.j, p.warping / unit**6 + tiny, p.shear[0, 0], p.shear[1, 1]]
        plain = [p.ixy / unit**4, *(p.eccentricity / unit), p.shear[0, 1] * p.area]
        return np.array([*np.log(logs), *plain])

    def __call__(self, values: Mapping[str, float]) -> SectionProperties:
        """Raises UsageError where a dimension is not positive."""
        if any(values[n] <= 0 for n in self._names):
            raise UsageError("a dimension of a section must be positive")
        if not self._names:
            return self._exact
        logs = np.log([values[n] / self._values[n] for n in self._names])
        row = self._base + (_terms(logs[None]) @ self._factors)[0]
        area, ixx, iyy, j, warping, s00, s11 = np.exp(row[:7]).tolist()
        unit = float(np.sqrt(area))
        return replace(
            self._exact,
            area=area,
            ixx=ixx,
            iyy=iyy,
            j=j,
            warping=max(warping - 1e-12, 0.0) * unit**6,
            ixy=float(row[7]) * unit**4,
            shear_centre=self._exact.centroid + row[8:10] * unit,
            shear=np.array([[s00, row[10] / area], [row[10] / area, s11]]),
        )


def _design(n: int) -> FloatArray:
    """(k, n) offsets: none, each either way, each pair together."""
    eye = np.eye(n)
    pairs = [eye[a] + eye[b] for a, b in itertools.combinations(range(n), 2)]
    return np.array([np.zeros(n), *eye, *(-eye), *pairs])


def _terms(x: FloatArray) -> FloatArray:
    """(k, t) linear, square and mixed terms of offsets (k, n)."""
    n = x.shape[1]
    mixed = [x[:, a] * x[:, b] for a, b in itertools.combinations_with_replacement(range(n), 2)]
    return np.stack([*x.T, *mixed], axis=1)


def std_of(found: Budget, name: str, value: float) -> float | None:
    """The standard deviation of a figure of the solid: in the ratio of the beam's. None where the beam's figure is none to scale."""
    base = found.value.get(name)
    if base is None or base == 0:
        return None
    return abs(value / base) * found.std[name]
