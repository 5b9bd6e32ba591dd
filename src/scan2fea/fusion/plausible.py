"""Whether rates are in the unit their log says: turned along by them, gravity must stay where it is."""

from __future__ import annotations

import math

from scan2fea.errors import InputError, require
from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.quaternions import between_samples, product, scaled_to_one, turned
from scan2fea.types import FloatArray, InertialLog

WINDOW_S = 1.0
_TOLD, _MUCH = 0.01, 3.0  # of what is lost when forces are added up; how much more than in the other unit


@jit_ieee
def incoherence(time: FloatArray, rate: FloatArray, force: FloatArray, factor: float) -> float:
    """Mean over windows of a second of what is lost when the specific forces are added up in a frame that the rates, times `factor`, keep still."""
    total, n = 0.0, 0
    q = (0.0, 0.0, 0.0, 1.0)
    sx = sy = sz = size = 0.0
    begun = time[0]
    for k in range(1, len(time)):
        a = (factor * rate[k - 1, 0], factor * rate[k - 1, 1], factor * rate[k - 1, 2])
        b = (factor * rate[k, 0], factor * rate[k, 1], factor * rate[k, 2])
        q = scaled_to_one(product(q, between_samples(a, b, time[k] - time[k - 1])))
        fx, fy, fz = turned(q, (force[k, 0], force[k, 1], force[k, 2]))
        sx, sy, sz = sx + fx, sy + fy, sz + fz
        size += math.sqrt(fx * fx + fy * fy + fz * fz)
        if time[k] - begun >= WINDOW_S and size > 0.0:
            total += 1.0 - math.sqrt(sx * sx + sy * sy + sz * sz) / size
            n += 1
            q, sx, sy, sz, size, begun = (0.0, 0.0, 0.0, 1.0), 0.0, 0.0, 0.0, 0.0, time[k]
    return total / n if n else 0.0


def require_unit(log: InertialLog) -> None:
    """Raises InputError where gravity says that rates taken for rad/s are degrees, or the other way round; a log at rest says nothing."""
    stated = incoherence(log.time_s, log.rate, log.force, 1.0)
    for factor, unit in ((math.pi / 180, "degrees per second, not radians"), (180 / math.pi, "radians per second, not degrees")):
        other = incoherence(log.time_s, log.rate, log.force, factor)
        short = "deg" if factor < 1 else "rad"
        says = (
            f"the rates of the inertial log are in {unit}: gravity turned along by them keeps {1 - other:.1%} of its size over a second, but "
            f"{1 - stated:.1%} as they are named; name the columns gx_{short}_s, ... or set fusion.angle_unit={short}, or the other to keep them"
        )
        require(not (stated > _TOLD and stated > _MUCH * other), InputError, says)
