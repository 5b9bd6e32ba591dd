"""Exact closed solids. Plane ones are exact; round ones are polygons with their vertices on the true circle, no chord farther from it than `chord_m`.

Each shape stands at the origin of its own frame; `posed` moves it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InputError, require
from scan2fea.kernel.transforms import applied
from scan2fea.simulation.polyhedra import drilled, meshed, prism, raised, revolved
from scan2fea.types import FloatArray, TriangleMesh

CHORD_M = 1e-4


def segments_of(radius: float, chord_m: float = CHORD_M) -> int:
    """Sides of the regular polygon whose chords stay within `chord_m` of the circle: r (1 - cos(pi / n)) <= chord, at least 8."""
    return max(8, math.ceil(math.pi / math.acos(max(0.0, 1.0 - chord_m / radius)))) if chord_m < radius else 8


def circle(radius: float, chord_m: float = CHORD_M) -> FloatArray:
    """(k, 2) counter-clockwise polygon with its vertices on the circle."""
    n = segments_of(radius, chord_m)
    angle = 2 * np.pi * np.arange(n) / n
    vertices: FloatArray = radius * np.c_[np.cos(angle), np.sin(angle)]
    return vertices


def _positive(**sizes: float) -> None:
    for name, value in sizes.items():
        require(math.isfinite(value) and value > 0, InputError, f"{name} is {value} m: it must be positive")


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def box(x: float, y: float, z: float) -> TriangleMesh:
    """A block from the origin to (x, y, z)."""
    _positive(x=x, y=y, z=z)
    return meshed(prism(_rectangle(0, 0, x, y), z))


def plate(b: float, t: float, length: float) -> TriangleMesh:
    """A flat bar, b wide and t thick, along z."""
    return box(b, t, length)


def cylinder(radius: float, length: float, chord_m: float = CHORD_M) -> TriangleMesh:
    """A round bar along z, about the z axis."""
    _positive(radius=radius, length=length)
    return meshed(prism(circle(radius, chord_m), length))


def chs(d: float, t: float, length: float, chord_m: float = CHORD_M) -> TriangleMesh:
    """A round tube along z, d the outer diameter, t the wall."""
    _positive(d=d, t=t, length=length)
    require(2 * t < d, InputError, f"a wall of {t} m does not fit a tube of {d} m")
    return meshed(prism(circle(d / 2, chord_m), length, [circle(d / 2 - t, chord_m)[::-1]]))


def rhs(h: float, b: float, t: float, length: float) -> TriangleMesh:
    """A rectangular tube along z, h along y, b along x, sharp corners."""
    _positive(h=h, b=b, t=t, length=length)
    require(2 * t < min(h, b), InputError, f"a wall of {t} m does not fit a tube of {h} x {b} m")
    return meshed(prism(_rectangle(0, 0, b, h), length, [_rectangle(t, t, b - t, h - t)[::-1]]))


def _angle(a: float, b: float, t: float) -> FloatArray:
    require(t < min(a, b), InputError, f"a thickness of {t} m does not fit legs of {a} and {b} m")
    return np.array([[0, 0], [b, 0], [b, t], [t, t], [t, a], [0, a]], float)


def l_beam(a: float, b: float, t: float, length: float) -> TriangleMesh:
    """An angle along z, leg a along y and leg b along x, its heel on the z axis, sharp corners. Area t (a + b - t)."""
    _positive(a=a, b=b, t=t, length=length)
    return meshed(prism(_angle(a, b, t), length))


def i_beam(h: float, b: float, tw: float, tf: float, length: float) -> TriangleMesh:
    """An I section along z, h along y, about the z axis, sharp corners. Area 2 b tf + (h - 2 tf) tw."""
    _positive(h=h, b=b, tw=tw, tf=tf, length=length)
    require(tw < b and 2 * tf < h, InputError, f"web {tw} m or flange {tf} m does not fit a section of {h} x {b} m")
    x, w, y, f = b / 2, tw / 2, h / 2, h / 2 - tf
    right = [[x, -y], [x, -f], [w, -f], [w, f], [x, f], [x, y]]
    return meshed(prism([*right, *[[-p, -q] for p, q in right]], length))


def bracket(
    a: float, b: float, t: float, width: float, holes: Sequence[tuple[str, float, float, float]], chord_m: float = CHORD_M
) -> TriangleMesh:
    """An angle plate (legs a along y, b along x, `width` along z) with round holes through its legs.

    holes : (leg "a" or "b", distance from the heel, z, radius). Area of the holes' walls is 2 pi r t each, to the chord tolerance.
    """
    _positive(a=a, b=b, t=t, width=width)
    solid = prism(_angle(a, b, t), width)
    # faces of the prism: 0 bottom, 1 top, 2.. the edges of the profile: 2 outside of leg b, 4 its inside, 5 inside of leg a, 7 its outside
    for leg, along, z, radius in holes:
        _positive(radius=radius)
        size = b if leg == "b" else a
        fits = leg in ("a", "b") and t < along - radius and along + radius < size and radius < z < width - radius
        require(fits, InputError, f"a hole of radius {radius} m at {along} m on leg {leg!r}, z = {z} m, leaves its leg")
        outline = circle(radius, chord_m)
        if leg == "b":
            solid = drilled(solid, 2, 4, (along, 0.0, z), (0.0, t, 0.0), outline)
        else:
            solid = drilled(solid, 7, 5, (0.0, along, z), (t, 0.0, 0.0), outline)
    return meshed(solid)


def table(x: float, y: float, height: float, top: float, leg: float, inset: float) -> TriangleMesh:
    """A table as one solid: a top x by y, `top` thick, on four square legs `inset` from its edges. Volume x y top + 4 leg^2 (height - top)."""
    _positive(x=x, y=y, height=height, top=top, leg=leg, inset=inset)
    require(top < height and 2 * (leg + inset) < min(x, y), InputError, f"a table of {x} x {y} x {height} m has no room for such legs")
    board = prism(_rectangle(0, 0, x, y), top)
    for x0 in (inset, x - inset - leg):
        for y0 in (inset, y - inset - leg):
            foot = _rectangle(x0, y0, x0 + leg, y0 + leg)[::-1]  # seen from below, outside, this runs counter-clockwise
            board = raised(board, 0, np.c_[foot, np.zeros(4)], height - top)
    return _moved(meshed(board), (0, 0, height - top))


def tank(radius: float, height: float, wall: float, chord_m: float = CHORD_M) -> TriangleMesh:
    """An open vessel about the z axis: a straight shell on an ellipsoidal 2:1 bottom, `wall` thick at the pole and along the shell."""
    _positive(radius=radius, height=height, wall=wall)
    depth = radius / 2
    require(wall < depth < height, InputError, f"a tank of radius {radius} m needs a wall below {depth} m and a height above it")
    angle = np.linspace(0, np.pi / 2, max(4, segments_of(radius, chord_m) // 4 + 1))
    outside = np.c_[radius * np.sin(angle), depth * (1 - np.cos(angle))]
    inside = np.c_[(radius - wall) * np.sin(angle), depth - (depth - wall) * np.cos(angle)]
    rim = [[radius, height], [radius - wall, height]]
    profile = np.concatenate([outside, rim, inside[::-1]])
    profile[[0, -1], 0] = 0.0
    return revolved(profile, segments_of(radius, chord_m))


def posed(mesh: TriangleMesh, T_world_shape: FloatArray) -> TriangleMesh:
    """The shape where it stands in the world."""
    return TriangleMesh(vertices=applied(T_world_shape, mesh.vertices), faces=mesh.faces)


def _moved(mesh: TriangleMesh, t: npt.ArrayLike) -> TriangleMesh:
    return TriangleMesh(vertices=mesh.vertices + np.asarray(t, float), faces=mesh.faces)
