"""One shot of a ranging sensor: a beam of some width becomes one return, and the returns of many shots become a Scan.

A beam with a footprint is cast as several rays of equal light over its cross-section (a Vogel spiral: even in area). Surfaces that lie
within the length of the pulse blend to one echo at their power-weighted mean range, which at an edge lies on neither surface (a mixed
pixel); of echoes farther apart the strongest is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.options import option
from scan2fea.simulation.casting import Hits, Target, hits
from scan2fea.simulation.motion import PathOptions
from scan2fea.simulation.noise import NoiseOptions, disturbed
from scan2fea.types import FloatArray, IntArray, PointCloud, Rays, Scan, Value

_GOLDEN_RAD = math.pi * (3.0 - math.sqrt(5.0))
_SHOTS_AT_ONCE = 1 << 17


@dataclass(frozen=True, kw_only=True)
class ReachOptions(NoiseOptions, PathOptions):
    """The reach of a ranging sensor, its noise and its path."""

    min_range_m: float = option(0.0, "Nearer surfaces are not measured", unit="m", minimum=0.0)
    max_range_m: float = option(1000.0, "Farther surfaces are not measured", unit="m", minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class BeamOptions(ReachOptions):
    """The beam of a ranging sensor."""

    divergence_mrad: float = option(0.0, "Full opening of the beam", unit="mrad", minimum=0.0, maximum=1000.0)
    footprint_rays: int = option(1, "Rays cast over the cross-section of each beam; 1: only its axis, so that no pixels mix", minimum=1, maximum=1024)
    pulse_m: float = option(
        0.75, "Surfaces nearer to each other along the beam blend to one return: half the length of the pulse", unit="m", minimum=0.0
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Shots(Value):
    """n shots. origin : (n, 3) metres.   direction : (n, 3) unit, axis of the beam.   time_s, ring : (n,)."""

    origin: FloatArray
    direction: FloatArray
    time_s: FloatArray
    ring: IntArray

    _ROWS = (("origin", "direction", "time_s", "ring"),)

    def __len__(self) -> int:
        return len(self.origin)


@dataclass(frozen=True, eq=False, kw_only=True)
class Echoes(Value):
    """The true return of n shots. range_m : (n,) nan for none.   thing : (n,) object that sends most of the light, -1 for none.

    cosine, shine : (n,) of the incidence, and reflectivity, both as means over the light that comes back, scaled by the share of the beam that it is.
    """

    range_m: FloatArray
    thing: IntArray
    cosine: FloatArray
    shine: FloatArray


def shoot(target: Target, shots: Shots, options: BeamOptions, rng: np.random.Generator, frame: int = 0) -> Scan:
    """One Scan of all shots in the world's frame; rows of its rays are the shots in their order."""
    opening = options.divergence_mrad * 1e-3
    return recorded(shots, echoes(target, shots, options), options, rng, opening_rad=opening, frame=frame)


def recorded(
    shots: Shots,
    echo: Echoes,
    options: ReachOptions,
    rng: np.random.Generator,
    *,
    opening_rad: float,
    frame: int = 0,
    more_m: FloatArray | float = 0.0,
) -> Scan:
    """One Scan of shots whose true returns are known; `more_m` is noise of the sensor's own, see `noise.disturbed`."""
    out_of_reach = (echo.range_m < options.min_range_m) | (echo.range_m > options.max_range_m)
    true = np.where(out_of_reach, np.nan, echo.range_m)
    got = disturbed(true, shots.direction, echo.cosine, echo.shine, options, rng, more_m)
    row = np.flatnonzero(np.isfinite(got.range_m))
    n = len(row)
    cloud = PointCloud(
        points=shots.origin[row] + got.range_m[row, None] * shots.direction[row] + got.offset_m[row],
        ray=row,
        frame=np.full(n, frame, np.int64),
        raw_index=np.arange(n, dtype=np.int64),
        sigma_along_m=got.sigma_along_m[row],
        sigma_across_m=got.sigma_across_m[row],
        intensity=(echo.shine * echo.cosine)[row],
        label=np.where(got.is_false[row], -1, echo.thing[row]),
    )
    opening = np.full(len(shots), opening_rad)
    rays = Rays(origin=shots.origin, direction=shots.direction, range_m=got.range_m, time_s=shots.time_s, ring=shots.ring, footprint_rad=opening)
    return Scan(cloud=cloud, rays=rays)


def echoes(target: Target, shots: Shots, options: BeamOptions) -> Echoes:
    """The true return of each shot; without noise, whatever the range."""
    parts = [_echoes_of(target, shots, options, slice(k, k + _SHOTS_AT_ONCE)) for k in range(0, max(len(shots), 1), _SHOTS_AT_ONCE)]
    return Echoes(
        range_m=np.concatenate([p.range_m for p in parts]),
        thing=np.concatenate([p.thing for p in parts]),
        cosine=np.concatenate([p.cosine for p in parts]),
        shine=np.concatenate([p.shine for p in parts]),
    )


def _echoes_of(target: Target, shots: Shots, options: BeamOptions, rows: slice) -> Echoes:
    origin, direction = shots.origin[rows], shots.direction[rows]
    m = options.footprint_rays if options.divergence_mrad > 0 else 1
    if m == 1:
        hit = hits(target, origin, direction)
        return Echoes(range_m=hit.range_m, thing=hit.thing, cosine=hit.cosine, shine=_shine(target, hit))
    n = len(origin)
    spread = footprint(direction, options.divergence_mrad * 1e-3, m)
    hit = hits(target, np.repeat(origin, m, axis=0), spread.reshape(-1, 3))
    shape = (n, m)
    found = _blended(
        hit.range_m.reshape(shape), hit.cosine.reshape(shape), _shine(target, hit).reshape(shape), hit.thing.reshape(shape), options.pulse_m
    )
    return Echoes(range_m=found[0], thing=found[1], cosine=found[2], shine=found[3])


def _shine(target: Target, hit: Hits) -> FloatArray:
    shine: FloatArray = np.where(hit.thing >= 0, target.reflectance[hit.thing], 0.0)
    return shine


def footprint(direction: FloatArray, opening_rad: float, m: int) -> FloatArray:
    """(n, m, 3) unit directions spread evenly over cones of the given full opening about (n, 3) axes."""
    radius = math.tan(opening_rad / 2) * np.sqrt((np.arange(m) + 0.5) / m)
    angle = _GOLDEN_RAD * np.arange(m)
    least = np.eye(3)[np.argmin(np.abs(direction), axis=1)]
    u = np.cross(direction, least)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(direction, u)
    side = (radius * np.cos(angle))[None, :, None] * u[:, None] + (radius * np.sin(angle))[None, :, None] * v[:, None]
    spread: FloatArray = direction[:, None] + side
    spread /= np.linalg.norm(spread, axis=2, keepdims=True)
    return spread


@jit
def _blended(
    range_m: FloatArray, cosine: FloatArray, shine: FloatArray, thing: IntArray, pulse_m: float
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """The strongest echo of each row: rays within `pulse_m` behind the first of an echo belong to it. Power of a ray: rho cos / r^2."""
    n, m = range_m.shape
    out, who = np.full(n, np.nan), np.full(n, -1)
    cos_out, shine_out = np.zeros(n), np.zeros(n)
    power = np.zeros(m)
    for i in range(n):
        order = np.argsort(range_m[i])  # nan last
        best, k = 0.0, 0
        while k < m and not math.isnan(range_m[i, order[k]]):
            first, total, middle, flat, dull = range_m[i, order[k]], 0.0, 0.0, 0.0, 0.0
            start = k
            while k < m and range_m[i, order[k]] <= first + pulse_m:
                j = order[k]
                power[k] = shine[i, j] * cosine[i, j] / max(range_m[i, j], 1e-6) ** 2
                total += power[k]
                middle += power[k] * range_m[i, j]
                flat += power[k] * cosine[i, j]
                dull += power[k] * shine[i, j]
                k += 1
            if total > best:
                best = total
                out[i], cos_out[i] = middle / total, flat / total
                shine_out[i] = dull / total * (k - start) / m
                most = 0.0
                for a in range(start, k):
                    mine = 0.0
                    for b in range(start, k):
                        if thing[i, order[b]] == thing[i, order[a]]:
                            mine += power[b]
                    if mine > most:
                        most, who[i] = mine, thing[i, order[a]]
    return out, who, cos_out, shine_out
