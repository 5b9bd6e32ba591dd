"""A section swept along a curve: from the pieces the fits give to the frame, bow and twist of `types.Member`, and from points to its coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import legendre

from scan2fea.estimation.axis import Axis
from scan2fea.estimation.fit import SectionFit
from scan2fea.kernel.straightened import straightened
from scan2fea.kernel.stretch import Stretch, stretch_of
from scan2fea.types import FloatArray, Member, Value

_ROUNDING = 1e-10  # of the length: what refitting the series leaves behind of nothing


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep(Value):
    """T_world_frame : (4, 4).   span : z from .. to, zeta = -1 .. 1.   axis : (2, k) metres and roll : (k,) radians, Legendre from degree 0 on.

    stretch : of a section that grows by growth_m (k,) at z = knots_m (k,), None for a prism.
    """

    T_world_frame: FloatArray
    span: tuple[float, float]
    axis: FloatArray
    roll: FloatArray
    stretch: Stretch | None = None
    knots_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    growth_m: FloatArray = field(default_factory=lambda: np.zeros(0))

    def coordinates(self, points: FloatArray) -> FloatArray:
        """(n, 3) world points as (x, y) in the frame of the section (the least one where it grows) and z along the frame."""
        axis, roll = np.array(self.axis), np.array(self.roll)  # that may be written to: else the kernel is compiled once more
        local = straightened(np.ascontiguousarray(points, float), np.array(self.T_world_frame), *self.span, axis, roll)
        if self.stretch is not None:
            local[:, :2] = self.stretch.undone(local[:, :2], np.interp(local[:, 2], self.knots_m, self.growth_m))
        return local

    def in_world(self, z: FloatArray, way: FloatArray) -> FloatArray:
        """(n, 3) the directions (n, 2) of the section at heights z (n,)."""
        roll = legendre.legval((2 * z - self.span[0] - self.span[1]) / (self.span[1] - self.span[0]), self.roll)
        cos, sin = np.cos(roll), np.sin(roll)
        turned = np.stack([cos * way[:, 0] - sin * way[:, 1], sin * way[:, 0] + cos * way[:, 1]], axis=1)
        return np.asarray(turned @ self.T_world_frame[:3, :2].T)

    def rebased(self, low: float, high: float) -> Sweep:
        """The same sweep over z = low .. high, in the frame whose z is its straight part, x the section's and origin on the axis at low."""
        degree = max(self.axis.shape[1], len(self.roll)) - 1
        z = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
        old = (2 * z - self.span[0] - self.span[1]) / (self.span[1] - self.span[0])
        new = (2 * z - low - high) / (high - low)
        axis = np.zeros((2, max(degree, 1) + 1))
        roll = np.zeros(max(degree, 1) + 1)
        axis[:, : degree + 1] = legendre.legfit(new, legendre.legval(old, self.axis.T).T, degree).T
        roll[: degree + 1] = legendre.legfit(new, legendre.legval(old, self.roll), degree)
        c, s = math.cos(roll[0]), math.sin(roll[0])
        along = np.array([*(2 * axis[:, 1] / (high - low)), 1.0])
        stretch = float(np.linalg.norm(along))
        e_z = along / stretch
        e_x = np.array([c, s, 0.0]) - e_z * (c * e_z[0] + s * e_z[1])
        e_x /= np.linalg.norm(e_x)
        T = np.eye(4)
        T[:3, :3] = np.stack([e_x, np.cross(e_z, e_x), e_z], 1)
        T[:3, 3] = [*(axis[:, 0] - axis[:, 1]), low]
        bow = np.array([[c, s], [-s, c]]) @ axis
        bow[:, :2] = 0.0
        bow[np.abs(bow) < _ROUNDING * (high - low)] = 0.0
        twist = roll.copy()
        twist[0] = 0.0
        twist[np.abs(twist) < _ROUNDING] = 0.0
        return Sweep(T_world_frame=self.T_world_frame @ T, span=(0.0, (high - low) * stretch), axis=bow, roll=twist)


def sweep_of(axis: Axis, fit: SectionFit) -> Sweep:
    """The sweep that the provisional axis and the section fitted to its straightened points make together."""
    low, high = fit.z_range
    section_axis, section_roll = fit.layout.axis(fit.theta), fit.layout.roll(fit.theta)
    turned = fit.T_points_fit[2, 2] < 0  # a half turn about x: y and z change sign
    degree = max(section_axis.shape[1], len(section_roll), axis.bow.shape[1], len(axis.twist)) - 1
    degree = degree + len(axis.twist) - 1 if axis.twist.any() else degree
    zeta = np.cos(np.pi * np.arange(degree + 2) / (degree + 1))
    z = 0.5 * (low + high) + 0.5 * (high - low) * zeta
    before = axis.zeta(-z if turned else z)
    bow, twist = legendre.legval(before, axis.bow.T), legendre.legval(before, axis.twist)
    if turned:
        bow, twist = bow * np.array([[1.0], [-1.0]]), -twist
    own = legendre.legval(zeta, section_axis.T)
    c, s = np.cos(twist), np.sin(twist)
    place = bow + np.stack([c * own[0] - s * own[1], s * own[0] + c * own[1]])
    roll = twist + legendre.legval(zeta, section_roll)
    return Sweep(
        T_world_frame=axis.T_world_axis @ fit.T_points_fit,
        span=(low, high),
        axis=legendre.legfit(zeta, place.T, degree).T,
        roll=legendre.legfit(zeta, roll, degree),
    )


def sweep_of_member(member: Member) -> Sweep:
    """The sweep of a finished member."""
    axis = np.zeros((2, max(member.bow.shape[1] + 2, 2)))
    axis[:, 2 : 2 + member.bow.shape[1]] = member.bow
    change, values = member.change, member.values()
    prism = Sweep(T_world_frame=member.T_world_member, span=(0.0, values["length"]), axis=axis, roll=np.r_[0.0, member.twist])
    if change is None:
        return prism
    stretch = stretch_of(member.family, values, change.dimension, change.side)
    return replace(prism, stretch=stretch, knots_m=change.z_m, growth_m=change.value_m - values[change.dimension])
