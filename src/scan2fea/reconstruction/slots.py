"""Round ends of slots: half cylinders that two flats end at, which touch it. With points half a wall apart an end has a dozen points, whose normals
are blended with those of the faces; but the flats tell its radius and its axis, and all that is left is where along them it lies.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.kernel.surfaces import CYLINDER, Surface
from scan2fea.reconstruction.bores import ALONG, CLEAR, EXACTLY, LEAST_POINTS
from scan2fea.reconstruction.lost_bores import BOTTOM, CORE
from scan2fea.reconstruction.plane_growing import FACING, Planes
from scan2fea.reconstruction.round_cuts import facets
from scan2fea.reconstruction.round_growing import CHORD, off_round_m
from scan2fea.types import BoolArray, FloatArray

SQUARE = 0.05  # cosine between the flats of a slot and the faces of its wall
WIDEST = 4.0  # spacings, radius: of a wider end the normals tell enough
HELD, EXPLAINED = 0.4, 0.8  # of the points due on an end; of those beyond the flats that lie on it: of a flat end half do
ODDS = math.log(1000.0)  # that points of an end lie on a half circle and not on a flat end, which has one place too
SECTORS, LEAST_SECTORS = 4, 3  # of the half turn, and of these with points
CLIP = 3.0  # spreads: what lies farther is neither's
STEPS = 4  # places tried in the width of a band of points; times the place is fitted


def slot_ends(points: FloatArray, planes: Planes, spacing_m: float, sigma_m: float) -> list[Surface]:
    """The round ends between flats that face each other through a wall. points : (n, 3) raw, in the rows of planes.label."""
    mean = np.array([points[planes.label == k].mean(axis=0) if (planes.label == k).any() else np.full(3, np.nan) for k in range(len(planes))])
    found: list[Surface] = []
    for i in range(len(planes)):
        for j in range(i + 1, len(planes)):
            if planes.normal[i] @ planes.normal[j] >= FACING:
                continue
            radius = 0.5 * float(planes.normal[j] @ mean[i] - planes.offset[j])
            if not 0.0 < radius <= WIDEST * spacing_m:
                continue
            for k in range(len(planes)):
                for m in range(k + 1, len(planes)):
                    is_wall = planes.normal[k] @ planes.normal[m] < FACING and planes.normal[m] @ mean[k] < planes.offset[m]
                    if is_wall and abs(planes.normal[k] @ planes.normal[i]) < SQUARE:
                        found += _ends(points, planes, (i, j), (k, m), radius, spacing_m, sigma_m)
    return found


def is_in_slot(bore: Surface, ends: list[Surface]) -> bool:
    """Does the axis of a bore lie at a round end, or between two: circles that touch both flats fit anywhere in a slot."""
    for one in ends:
        for other in ends:
            to, way = (np.asarray(s.point - one.point - ((s.point - one.point) @ one.axis) * one.axis) for s in (bore, other))  # square to the axis
            share = float(np.clip(to @ way / max(float(way @ way), 1e-300), 0.0, 1.0))
            if abs(bore.axis @ one.axis) > ALONG and abs(other.axis @ one.axis) > ALONG and np.linalg.norm(to - share * way) < one.radius:
                return True
    return False


def _ends(
    points: FloatArray, planes: Planes, flats: tuple[int, int], wall: tuple[int, int], radius: float, spacing_m: float, sigma_m: float
) -> list[Surface]:
    """The ends of a slot between two flats, through the wall between two faces."""
    off, clear = off_round_m(spacing_m, sigma_m), CLEAR * sigma_m + EXACTLY * spacing_m
    axis, across = planes.normal[wall[0]], planes.normal[flats[0]]
    along = np.cross(axis, across)
    along /= np.linalg.norm(along)
    depth = -np.maximum(*(planes.plane(k).distance(points) for k in wall))
    thick = -float(np.median(planes.plane(wall[1]).distance(points[planes.label == wall[0]])))
    aside, far = planes.plane(flats[0]).distance(points) - radius, points @ along  # aside : from the middle between the flats
    between = (depth > clear) & (np.abs(aside) <= radius + off)
    of_flats = between & np.isin(planes.label, flats)
    on_faces = (np.abs(depth) <= clear) & (np.abs(aside) <= radius + off)
    if of_flats.sum() < 2 * LEAST_POINTS:
        return []
    found: list[tuple[Surface, float]] = []
    for side in (-1.0, 1.0):
        place = _placed(side * far, aside, between, of_flats, radius, off, spacing_m)
        if place is None:
            continue
        own = between & _is_on(side * far, aside, place, radius, off)
        inside = (between | on_faces) & (np.hypot(side * far - place, aside) < CORE * radius)
        beyond = between & (side * far > place) & (side * far <= place + radius + spacing_m)
        due = math.pi * radius * (thick - 2.0 * clear) / spacing_m**2
        turn = np.floor((np.arctan2(aside[own], side * far[own] - place) / math.pi + 0.5) * SECTORS)
        is_told = len(np.unique(np.clip(turn, 0, SECTORS - 1))) >= LEAST_SECTORS and own.sum() >= max(LEAST_POINTS, HELD * due)
        if is_told and own.sum() >= EXPLAINED * beyond.sum() and inside.sum() < BOTTOM:
            middle = points[own].mean(axis=0)
            middle += (planes.offset[flats[0]] + radius - across @ middle) * across + (side * place - along @ middle) * along
            end = Surface(kind=CYLINDER, point=middle, axis=axis, radius=radius + 2.0 * float(planes.std_m[list(flats)].max()), sense=-1)
            end = replace(end, radius=end.radius**2 / facets(end, spacing_m)[1])  # its sides reach the flats, or space before and behind is one
            found.append((end, _odds(side * far[beyond] - place, aside[beyond], radius, math.hypot(sigma_m, CHORD * spacing_m))))
    is_slot = max((odds for _, odds in found), default=0.0) >= ODDS
    return [end for end, odds in found if is_slot and odds > 0.0]  # the other end of a slot is round too, where nothing is against it


def _odds(far: FloatArray, aside: FloatArray, radius: float, spread: float) -> float:
    """Log of the odds that points (n,) beyond the flats are of a half circle about the place 0, and not of a flat end square to these, wherever."""
    flat, most = np.abs(np.abs(aside) - radius), CLIP * spread
    square = min((float((np.minimum(np.minimum(flat, most), np.abs(far - at)) ** 2).sum()) for at in far), default=0.0)
    return (square - float((np.minimum(np.abs(np.hypot(far, aside) - radius), most) ** 2).sum())) / (2.0 * spread**2)


def _is_on(far: FloatArray, aside: FloatArray, place: float, radius: float, off: float) -> BoolArray:
    return np.asarray((far > place) & (np.abs(np.hypot(far - place, aside) - radius) <= off))


def _placed(far: FloatArray, aside: FloatArray, between: BoolArray, of_flats: BoolArray, radius: float, off: float, spacing_m: float) -> float | None:
    """How far along the flats the middle of an end lies on which most points do, fitted to these; None where they are too few."""
    last = float(far[of_flats].max())
    tried = np.arange(last - radius - 2.0 * spacing_m, last + radius + 2.0 * spacing_m, off / STEPS)
    # what lies beyond and not on the end speaks against it: of the flats as many points lie on a circle that touches them
    held = [
        int(2 * np.sum(between & _is_on(far, aside, at, radius, off)) - np.sum(between & (far > at) & (far <= at + radius + off))) for at in tried
    ]
    place = float(np.mean(tried[np.array(held) == max(held)]))
    for _ in range(STEPS):
        own = between & _is_on(far, aside, place, radius, off)
        if own.sum() < LEAST_POINTS:
            return None
        away = np.hypot(far[own] - place, aside[own])
        slope = (far[own] - place) / away  # of the distance, as the end moves
        place += float((slope * (away - radius)).sum() / (slope**2).sum())
    return place
