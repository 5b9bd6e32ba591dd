"""Which dimensions the data tell: a number without this gate is a guess with error bars.

A wall is seen either because its two sides stand apart from the noise (t > 2 sigma), or because the noise is known well enough to be subtracted:
dt = (4 sigma^2 / t) (dsigma / sigma), 10 % of t needs dsigma / sigma < 0.025 (t / sigma)^2 (shape-estimation.md, "Limit", method 10). A noise that
was fitted along with t is known only as well as its law is: the thickness is believed where every plausible law of noise gives the same.
"""

from __future__ import annotations

from collections.abc import Mapping

from scan2fea.estimation.anneal import walls

RESOLVED = 2.0  # t / sigma from which both sides of a wall stand apart, if the law of the noise is right
SEPARATE = 4.0  # the same under any law: a box has the kurtosis of two Gaussian sheets 3.7 of their sigma apart
CALIBRATED = 0.025  # of (t / sigma)^2: the relative error of a stated sigma that still gives t within 10 %
KERNEL_SPREAD = 0.1  # of t: laws of noise that agree within this do not matter
RELATIVE = 0.25  # a dimension whose sd exceeds this part of it is not told (the targets' "wherever CRB_t < t / 4")


def thickness_observable(
    t_m: float,
    std_m: float,
    sigma_m: float,
    *,
    sigma_error: float | None = None,
    kernel_spread_m: float | None = None,
    plausible_spread_m: float | None = None,
) -> tuple[bool, str]:
    """Whether a wall thickness may be reported, and why not.

    sigma_error : relative error of a sigma that was calibrated elsewhere, None where it was fitted.   kernel_spread_m : largest difference of t
    between laws of noise, plausible_spread_m : between those that are not far behind; None where only one was tried.
    """
    if not 0 < std_m < RELATIVE * t_m:
        return False, "its standard deviation exceeds a quarter of it" if std_m > 0 else "the points do not depend on it"
    agree = plausible_spread_m is None or plausible_spread_m < KERNEL_SPREAD * t_m
    if t_m > (RESOLVED if agree else SEPARATE) * sigma_m:
        return True, ""
    if sigma_error is not None and sigma_error < CALIBRATED * (t_m / sigma_m) ** 2:
        return True, ""
    if kernel_spread_m is not None and kernel_spread_m < KERNEL_SPREAD * t_m:
        return True, ""
    times = RESOLVED if agree else SEPARATE
    return False, f"the wall is thinner than {times:g} sigma of the noise and the law of the noise is not known well enough to subtract it"


def observable(
    family: str,
    values: Mapping[str, float],
    std: Mapping[str, float],
    sigma_m: float,
    *,
    sigma_error: float | None = None,
    kernel_spread: Mapping[str, float] | None = None,
    plausible_spread: Mapping[str, float] | None = None,
) -> dict[str, tuple[bool, str]]:
    """Per dimension: whether the data tell it, and why not (empty where they do). std 0 means that the information has no such direction."""
    found = {}
    for name, value in values.items():
        if name in walls(family):
            spread = None if kernel_spread is None else kernel_spread.get(name)
            near = None if plausible_spread is None else plausible_spread.get(name)
            found[name] = thickness_observable(
                value, std[name], sigma_m, sigma_error=sigma_error, kernel_spread_m=spread, plausible_spread_m=near
            )
        elif std[name] <= 0:
            found[name] = (False, "the points do not depend on it")
        elif std[name] >= RELATIVE * value:
            found[name] = (False, "its standard deviation exceeds a quarter of it")
        else:
            found[name] = (True, "")
    return found
