"""Every shape is closed, oriented and of the volume its dimensions say."""

import math

import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.kernel.measures import area, face_areas, volume
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.simulation import shapes
from scan2fea.types import TriangleMesh

CHORD = 1e-4


def polygon_factor(radius: float) -> float:
    """Area of the polygon over the area of its circle."""
    n = shapes.segments_of(radius, CHORD)
    return n / (2 * math.pi) * math.sin(2 * math.pi / n)


def assert_closed(mesh: TriangleMesh) -> None:
    """Every directed edge once, and its opposite once; every vertex used; no triangle without area."""
    directed = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    assert len(np.unique(directed, axis=0)) == len(directed)
    assert {tuple(e) for e in directed.tolist()} == {tuple(e[::-1]) for e in directed.tolist()}
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)
    assert face_areas(mesh).min() > 0


def hole(radius: float) -> float:
    return math.pi * radius**2 * polygon_factor(radius)


HOLES = [("a", 0.06, 0.03, 0.011), ("a", 0.06, 0.09, 0.011), ("b", 0.05, 0.06, 0.009), ("b", 0.085, 0.02, 0.006), ("b", 0.085, 0.1, 0.006)]
SOLIDS = {
    "box": (shapes.box(0.4, 0.3, 0.2), 0.024),
    "plate": (shapes.plate(0.1, 0.008, 2.0), 0.0016),
    "cylinder": (shapes.cylinder(0.25, 0.6, CHORD), math.pi * 0.0625 * 0.6 * polygon_factor(0.25)),
    "chs": (shapes.chs(0.06, 0.004, 0.3, CHORD), 0.3 * math.pi * (0.03**2 * polygon_factor(0.03) - 0.026**2 * polygon_factor(0.026))),
    "rhs": (shapes.rhs(0.14, 0.08, 0.006, 1.5), (0.14 * 0.08 - 0.128 * 0.068) * 1.5),
    "l_beam": (shapes.l_beam(0.127, 0.127, 0.00635, 3.048), 0.00635 * (2 * 0.127 - 0.00635) * 3.048),
    "i_beam": (shapes.i_beam(0.2, 0.1, 0.0056, 0.0085, 2.0), 2.0 * (2 * 0.1 * 0.0085 + (0.2 - 0.017) * 0.0056)),
    "bracket": (shapes.bracket(0.1, 0.12, 0.008, 0.12, HOLES, CHORD), 0.008 * (0.22 - 0.008) * 0.12 - 0.008 * sum(hole(h[3]) for h in HOLES)),
    "table": (shapes.table(1.2, 0.8, 0.75, 0.03, 0.05, 0.04), 1.2 * 0.8 * 0.03 + 4 * 0.05**2 * 0.72),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_closed_and_of_its_volume(name: str) -> None:
    mesh, expected = SOLIDS[name]
    assert_closed(mesh)
    assert volume(mesh) == pytest.approx(expected, rel=1e-12)
    T = rigid(random_rotation(3), [1.0, -2.0, 0.5])
    assert volume(shapes.posed(mesh, T)) == pytest.approx(expected, rel=1e-11)


def test_tank_volume_tends_to_the_closed_form() -> None:
    radius, height, wall = 0.15, 0.35, 0.01
    d = radius / 2
    half_ellipsoids = 2 / 3 * math.pi * (radius**2 * d - (radius - wall) ** 2 * (d - wall))
    expected = half_ellipsoids + math.pi * (radius**2 - (radius - wall) ** 2) * (height - d)
    errors = []
    for chord in (4e-4, 1e-4, 2.5e-5):
        mesh = shapes.tank(radius, height, wall, chord)
        assert_closed(mesh)
        errors.append(abs(volume(mesh) - expected) / expected)
    rate = np.polyfit(np.log([4e-4, 1e-4, 2.5e-5]), np.log(errors), 1)[0]
    assert errors[-1] < 5e-4
    assert rate == pytest.approx(1.0, abs=0.15)  # a chord error of c costs a volume in proportion to c


def test_l_beam_is_the_thesis_beam() -> None:
    mesh = SOLIDS["l_beam"][0]
    assert volume(mesh) == pytest.approx(4.7932e-3, rel=1e-4)
    assert area(mesh) == pytest.approx(1.5515, rel=1e-4)


def test_round_holes_keep_the_chord_tolerance() -> None:
    for radius in (0.003, 0.05, 2.0):
        n = shapes.segments_of(radius, CHORD)
        assert radius * (1 - math.cos(math.pi / n)) <= CHORD * (1 + 1e-12)
        assert n == 8 or radius * (1 - math.cos(math.pi / (n - 1))) > CHORD


@pytest.mark.parametrize(
    "make",
    [
        lambda: shapes.box(0.1, 0.1, 0.0),
        lambda: shapes.l_beam(0.1, 0.1, 0.1, 1.0),
        lambda: shapes.rhs(0.1, 0.1, 0.05, 1.0),
        lambda: shapes.chs(0.1, 0.05, 1.0),
        lambda: shapes.i_beam(0.2, 0.1, 0.1, 0.01, 1.0),
        lambda: shapes.bracket(0.1, 0.1, 0.008, 0.1, [("a", 0.095, 0.05, 0.01)]),
        lambda: shapes.bracket(0.1, 0.1, 0.008, 0.1, [("c", 0.05, 0.05, 0.01)]),
        lambda: shapes.table(0.1, 0.1, 0.5, 0.02, 0.05, 0.01),
        lambda: shapes.tank(0.1, 0.2, 0.06),
        lambda: shapes.box(float("nan"), 1.0, 1.0),
    ],
)
def test_impossible_sizes_are_refused(make) -> None:
    with pytest.raises(InputError, match="m"):
        make()
