"""Members and boxes as scans show them at their worst: faces hidden, cut, from a few stations, in noise of any law, among strays.

Sizes of the table or off it, any pose, unit and noise. Every number is drawn from the ranges below; a case is kept whatever the program makes of it.
"""

from __future__ import annotations

import math

import numpy as np
from case_shapes import Case, in_logarithm, member_shape, part_shape, unobservable

from scan2fea.estimation.table import shipped_table
from scan2fea.estimation.visible import visible_sets
from scan2fea.kernel.section_likelihood import face_lengths, faces
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid
from scan2fea.simulation.members import member
from scan2fea.simulation.solids import Shape

KINDS = ("L", "C", "I", "T", "RHS", "CHS", "rect", "box")
WAYS = ("full", "hidden", "stations told", "seen from one side", "stations", "cut")
_SIZE_M = (0.05, 0.5)
_NOISE_M = (1e-4, 3e-3)
_WORST_NOISE_M, _WORST_EVERY = (0.01, 0.02), 12  # the thesis's noise, once in so many cases
_NOISE_OF_WALL = 0.35  # elsewhere at most
_POINTS = (6_000, 60_000)
_LEAST_SEEN = 0.4  # of the outline, where faces are hidden
_CLUTTER, _CLUTTERED = 0.15, 0.4


def hard(number: int, seed: int, rng: np.random.Generator) -> Case:
    """One case: kinds and ways take turns."""
    kind, way = KINDS[number % len(KINDS)], WAYS[(number + number // len(KINDS) + seed) % len(WAYS)]
    shape, wall = _shape(kind, rng)
    mesh, R = shape.mesh, quaternion_to_matrix(rng.standard_normal(4))
    far = rng.random() < 0.1 and not way.startswith("stations")  # whose files hold single precision
    origin = rng.uniform(-4, 4, 3) + (np.array([412_000.0, 5_318_000.0, 300.0]) if far else 0)
    is_worst = number % _WORST_EVERY == 0
    sigma = rng.uniform(*_WORST_NOISE_M) if is_worst else min(in_logarithm(rng, *_NOISE_M), _NOISE_OF_WALL * wall)
    case = Case(
        kind=kind,
        shape=shape,
        mesh=mesh,
        T=rigid(R, origin),
        sigma_m=float(f"{sigma:.3g}"),
        noise=str(rng.choice(["gauss", "uniform", "laplace"])),
        unit="m" if far else str(rng.choice(["m", "mm", "in"])),
        n_points=int(in_logarithm(rng, *_POINTS)),
        expect="may_fail" if is_worst else "convert",
    )
    if way.startswith("stations"):
        case.stations, case.tells_places, case.noise, case.expect = True, way == "stations told", "gauss", "may_fail"
        case.places = _places(case, rng)
        return case
    case.clutter = _CLUTTER if rng.random() < _CLUTTERED else 0.0
    if way == "cut" or (way != "full" and kind in ("CHS", "box")):  # these have no faces to hide
        case.cut, case.expect = (rng.uniform(_LEAST_SEEN, 0.95), rng.uniform(0, 2 * math.pi)), "may_fail"
    elif way != "full":
        case.hidden = _hidden(case, way, rng)
        case.unobservable = unobservable(kind, case.hidden)
        case.expect = "may_fail" if case.unobservable or is_worst else "convert"
    return case


def _shape(kind: str, rng: np.random.Generator) -> tuple[Shape, float]:
    """The shape and its thinnest wall."""
    size = in_logarithm(rng, *_SIZE_M)
    if kind == "box":
        return part_shape("box", size, rng)[0], 0.15 * size
    if kind != "rect" and rng.random() < 0.5:
        rows = [row for row in shipped_table().of(kind) if _SIZE_M[0] < max(row.parameters.values()) < _SIZE_M[1]]
        values = dict(rows[int(rng.integers(len(rows)))].parameters)
        size = max(values.values())
        return member(kind, {**values, "length": float(f"{size * rng.uniform(4, 14):.3g}")}, 5e-5 * size), min(values.values())
    shape, _, wall = member_shape(kind, size, rng)
    return shape, wall


def _places(case: Case, rng: np.random.Generator) -> np.ndarray:
    """(k, 3) stations round the member, by turns towards one end and the other, over a third of a turn, a half or all of it."""
    n, turn = int(rng.integers(3, 9)), float(rng.choice([2 * math.pi / 3, math.pi, 2 * math.pi]))
    low, high = case.mesh.vertices.min(axis=0), case.mesh.vertices.max(axis=0)
    reach = float(np.linalg.norm(high - low))
    angle = rng.uniform(0, 2 * math.pi) + np.arange(n) * turn / n
    along = np.where(np.arange(n) % 2, 0.6, -0.6) * (high - low)[2]
    local = (low + high) / 2 + np.column_stack([max(1.5, 0.9 * reach) * np.cos(angle), max(1.5, 0.9 * reach) * np.sin(angle), along])
    return np.asarray(local @ case.T[:3, :3].T + case.T[:3, 3])


def _hidden(case: Case, way: str, rng: np.random.Generator) -> tuple[str, ...]:
    """One to three faces drawn at random, or all that sensors on one side do not see."""
    values = {name: case.shape.parameters[name] for name in PARAMETERS[case.kind]}
    names = faces(case.kind)
    share = dict(zip(names, face_lengths(case.kind, np.array(list(values.values()))), strict=True))
    seen = set(names)
    if way == "hidden":
        for i in rng.permutation(len(names))[: int(rng.integers(1, 4))]:
            if _share(share, seen - {names[i]}) >= _LEAST_SEEN:
                seen.remove(names[i])
    else:
        sets = [one for one in visible_sets(case.kind, values) if _LEAST_SEEN <= _share(share, set(one)) < 0.97]
        seen = set(sets[int(rng.integers(len(sets)))])
    return tuple(name for name in names if name not in seen)


def _share(length: dict[str, float], seen: set[str]) -> float:
    return sum(length[name] for name in seen) / sum(length.values())
