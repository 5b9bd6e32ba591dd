"""The Earth (WGS 84): satellite coordinates to metres east, north and up, and gravity."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.types import FloatArray

SEMI_MAJOR_M, FLATTENING = 6378137.0, 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
EARTH_RATE_RAD_S = 7.292115e-5
STANDARD_GRAVITY = 9.80665  # ISO 80000-3
MEAN_RADIUS_M = 6371008.8
_EQUATOR_GRAVITY, _SOMIGLIANA, _FREE_AIR = 9.7803253359, 0.00193185265241, 3.086e-6


def earth_centred(latitude: FloatArray, longitude: FloatArray, height_m: FloatArray) -> FloatArray:
    """(n, 3) metres from the centre of the Earth, of angles in radians and heights over the ellipsoid."""
    s = np.sin(latitude)
    n = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_2 * s * s)
    flat = (n + height_m) * np.cos(latitude)
    return np.stack([flat * np.cos(longitude), flat * np.sin(longitude), (n * (1 - ECCENTRICITY_2) + height_m) * s], axis=-1)


def east_north_up(latitude: FloatArray, longitude: FloatArray, height_m: FloatArray, origin: FloatArray) -> FloatArray:
    """(n, 3) metres in the axes that touch the ellipsoid below `origin` (latitude, longitude in radians, height)."""
    away = earth_centred(latitude, longitude, height_m) - earth_centred(*origin)
    (sp, sl), (cp, cl) = np.sin(origin[:2]), np.cos(origin[:2])
    axes = np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])
    return np.asarray(away @ axes.T)


def gravity(latitude: float, height_m: float) -> float:
    """Normal gravity, m/s^2 (Somigliana's formula, less the free-air gradient)."""
    s2 = math.sin(latitude) ** 2
    return _EQUATOR_GRAVITY * (1 + _SOMIGLIANA * s2) / math.sqrt(1 - ECCENTRICITY_2 * s2) - _FREE_AIR * height_m


def world_of(origin: FloatArray | None) -> FloatArray:
    """(5,) gravity (m/s^2), radius of the Earth (m) and its rate along east, north, up (rad/s) there; without origin standard gravity, no turning."""
    if origin is None:
        return np.array([STANDARD_GRAVITY, 1e15, 0.0, 0.0, 0.0])
    latitude = float(origin[0])
    turn = EARTH_RATE_RAD_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    return np.array([gravity(latitude, float(origin[2])), MEAN_RADIUS_M, *turn])
