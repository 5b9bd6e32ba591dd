"""The section that the points show along each axis that they may have, and which axis and section are likeliest."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import EstimationError, InputError
from scan2fea.estimation.axis import Axis, tilted, turned
from scan2fea.estimation.fit import MIN_POINTS, FitOptions, SectionFit, fit_section
from scan2fea.estimation.initial import Start, starts
from scan2fea.estimation.likelihood import hull_area
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.noise_kernels import KERNELS
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.options import option
from scan2fea.types import FloatArray

_POINTS_PER_DEGREE = 150  # points for each degree of curve that is fitted
_UPRIGHT = 2e-3  # slope of the section across its axis above which it is fitted again along it: the fit shears, errors grow as the square
_RETURNS = 1


@dataclass(frozen=True, kw_only=True)
class MemberOptions:
    """What is known of the member."""

    family: str = option("", "Family of its section where it is known; empty: all are tried", choices=("", *PARAMETERS))
    noise: str = option("auto", "Law of the noise; auto: the likeliest", choices=("auto", *KERNELS))
    max_degree: int = option(4, "Highest degree of the curve of its axis; 1 for a straight member", minimum=1, maximum=4)
    twist: bool = option(True, "Whether the section may turn along the axis")
    sigma_m: float | None = option(None, "Noise of the points where it is known, one standard deviation; none: it is fitted", unit="m", minimum=1e-9)
    sigma_error: float = option(0.02, "How well sigma_m is known, relative", minimum=0.0, maximum=1.0)
    whole: bool = option(False, "Nothing hid it from the scan and nothing was cut off it: faces, and the member, end where the scan of them does")
    seed: int = option(0, "Seed of the draws of subsamples", minimum=0)


def _section(
    points: FloatArray,
    axis: Axis,
    options: MemberOptions,
    families: tuple[str, ...],
    fixed: Mapping[str, float],
    begun: tuple[Start, ...] = (),
) -> SectionFit | EstimationError:
    """The section seen along one axis. A short member's axis may show no section at all: the error is kept until all axes were tried."""
    straight = axis.straightened(points)
    degree = int(np.clip(len(points) // _POINTS_PER_DEGREE, 1, options.max_degree))
    slender = axis.ends[1] - axis.ends[0] >= 2 * axis.size_m
    fit_options = FitOptions(
        families=families,
        noise=options.noise,
        n_bow=degree - 1 if slender else 0,
        n_twist=1 if options.twist and slender and degree > 1 else 0,
        sigma_m=options.sigma_m,
        sigma_error=options.sigma_error,
        seed=options.seed,
    )
    try:
        with np.errstate(all="ignore"):  # steps into impossible sections are refused by their likelihood
            return fit_section(straight, fit_options, fixed=fixed, begun=begun)
    except (EstimationError, InputError) as error:
        return EstimationError(str(error))
    except np.linalg.LinAlgError:
        return EstimationError(f"no section explains the {len(points)} points; where they are several bodies, segment first")


def likeliest(
    points: FloatArray, axes: tuple[Axis, ...], options: MemberOptions, families: tuple[str, ...], fixed: Mapping[str, float]
) -> tuple[Axis, SectionFit]:
    """The axis and its section. Several axes are told apart by quick searches on few points; a box is a bar along each: the longest is its length."""
    begun: list[tuple[Start, ...]] = [()] * len(axes)
    if len(axes) > 1:
        quick = [_quick(points, axis, families, options.seed) for axis in axes]
        order = sorted(range(len(axes)), key=lambda k: (quick[k][0], k))
        if quick[order[0]][1] == "rect":
            order.sort(key=lambda k: (quick[k][1] != "rect", axes[k].ends[0] - axes[k].ends[1]))
        axes, begun = tuple(axes[k] for k in order), [quick[k][2] for k in order]
    failed: EstimationError | None = None
    for axis, starting in zip(axes, begun, strict=True):
        # an angle of unequal legs that are given has one way to run along its axis
        ways = (axis, turned(axis)) if fixed.get("a") != fixed.get("b") else (axis,)
        tried = [_upright(points, way, options, families, fixed, starting if way is axis else ()) for way in ways]
        fitted = [(way, fit) for way, fit in tried if isinstance(fit, SectionFit)]
        if fitted:
            return min(fitted, key=lambda one: one[1].bic)
        failed = failed or next(fit for _, fit in tried if isinstance(fit, EstimationError))
    raise failed or EstimationError("no section fits the points")


def _upright(
    points: FloatArray,
    axis: Axis,
    options: MemberOptions,
    families: tuple[str, ...],
    fixed: Mapping[str, float],
    begun: tuple[Start, ...] = (),
) -> tuple[Axis, SectionFit | EstimationError]:
    """The section along an axis that is tilted until the section stands upright on it. begun : starts along the axis, where there are any."""
    fit = _section(points, axis, options, families, fixed, begun)
    for _ in range(_RETURNS):
        slope = _slope(fit) if isinstance(fit, SectionFit) else np.zeros(2)
        if axis.bow.any() or axis.twist.any() or float(np.abs(slope).max()) < _UPRIGHT:
            break
        axis = tilted(axis, points, slope, options.seed)
        left = tuple(fit.families) if isinstance(fit, SectionFit) else families  # those that the slope did not put out of question
        fit = _section(points, axis, options, left, fixed)
    return axis, fit


def _slope(fit: SectionFit) -> FloatArray:
    """(2,) how far the fitted section moves across the provisional axis per metre along it, in the frame of the points."""
    low, high = fit.z_range
    across = fit.T_points_fit[:3, :3] @ np.array([*(2 * fit.layout.axis(fit.theta)[:, 1] / (high - low)), 1.0])
    return np.asarray(across[:2] / across[2])


def _quick(points: FloatArray, axis: Axis, families: tuple[str, ...], seed: int) -> tuple[float, str, tuple[Start, ...]]:
    """BIC per point of the density in space along an axis, comparable between axes, the family it is of, and all starts; from some hundred points."""
    straight = axis.straightened(points)
    low, high = axis.ends
    margin = 0.1 * (high - low)
    inside = straight[(straight[:, 2] > low + margin) & (straight[:, 2] < high - margin)]
    if len(inside) < MIN_POINTS:
        return math.inf, "", ()
    try:
        found = starts(inside, families, (low + margin, high - margin), hull_area(inside[sampled_rows(len(inside), 20_000, seed), :2]), seed)
    except InputError:
        return math.inf, "", ()
    best = min(found, key=lambda one: one.bic)
    n = min(len(inside), 600)
    share = len(inside) / len(points)  # what is inside the trimmed ends is 0.8 of a member's points: caps count against an axis
    return best.bic / n + 2 * math.log(0.8 * (high - low) / max(share, 1e-9)), best.layout.family, tuple(found)


def freed(points: FloatArray, axis: Axis, options: MemberOptions, fit: SectionFit) -> SectionFit | None:
    """The same family on the same points with every dimension free; None where no such section fits."""
    free = _section(points, axis, dataclasses.replace(options, family=fit.family), (fit.family,), {})
    return free if isinstance(free, SectionFit) else None
