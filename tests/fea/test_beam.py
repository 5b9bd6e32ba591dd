import dataclasses
import math

import numpy as np
import pytest

from scan2fea.errors import SolveError
from scan2fea.fea.beam import (
    assemble_beams,
    axial_forces,
    buckling,
    clamped,
    frequencies,
    geometric,
    solve_beams,
    straight,
)
from scan2fea.fea.beam_theory import (
    CANTILEVER_ROOTS,
    FREE_ROOTS,
    bending_frequency,
    buckling_loads,
    middle_deflection,
    tip_under_force,
    tip_under_tension,
    tip_under_torque,
    tip_under_weight,
    torsional_frequency,
)
from scan2fea.fea.section_properties import properties_of
from scan2fea.types import Material

STEEL = Material(name="steel", youngs_pa=200e9, poisson=0.3, density_kg_m3=7850.0, yield_pa=None, source="")
ANGLE = properties_of("L", {"a": 0.127, "b": 0.127, "t": 0.00635})
CHANNEL = properties_of("C", {"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115})
GIRDER = properties_of("I", {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085})
BAR = properties_of("rect", {"b": 0.02, "t": 0.02})
CASES = [(ANGLE, 3.048), (CHANNEL, 2.0), (GIRDER, 2.0), (BAR, 0.8)]


def cantilever(p, length, n=24):
    beams = straight(length, p, STEEL, n)
    matrices = assemble_beams(beams)
    return beams, matrices, clamped(beams, matrices, 0)


def tip(matrices, held, n, **load):
    at = {"fx": 0, "fy": 1, "fz": 2, "tz": 5}
    f = np.zeros((len(held), 1))
    for name, value in load.items():
        f[6 * n + at[name]] = value
    return solve_beams(matrices, held, f)


@pytest.mark.parametrize(("p", "length"), CASES)
def test_tip_against_closed_forms(p, length):
    n = 24
    _, matrices, held = cantilever(p, length, n)
    u, twist = tip_under_force(p, STEEL, length, np.array([30.0, -100.0]))
    found = tip(matrices, held, n, fx=30.0, fy=-100.0)[6 * n : 6 * n + 6, 0]
    assert found[:2] == pytest.approx(u, rel=1e-4)
    assert found[5] == pytest.approx(twist, rel=1e-3, abs=1e-8)
    assert tip(matrices, held, n, tz=10.0)[6 * n + 5, 0] == pytest.approx(tip_under_torque(p, STEEL, length, 10.0), rel=4e-3)
    assert tip(matrices, held, n, fz=1e3)[6 * n + 2, 0] == pytest.approx(tip_under_tension(p, STEEL, length, 1e3), rel=1e-9)
    weight = np.zeros((len(held), 1))
    weight[1 : 6 * (n + 1) : 6] = -9.80665
    found = solve_beams(matrices, held, matrices.mass @ weight)[6 * n : 6 * n + 6, 0]
    u, twist = tip_under_weight(p, STEEL, length, np.array([0.0, -9.80665]))
    assert found[:2] == pytest.approx(u, rel=1e-3, abs=1e-9) and found[5] == pytest.approx(twist, rel=2e-3, abs=1e-8)


def test_the_l_beam_of_the_thesis():
    """HEX20R 10 080 elements (notes of the project): -1.5707, -3.1032 mm, 5.739 mrad; 7.706, 11.29, 22.30, 40.3, 47.84 Hz."""
    n = 24
    _, matrices, held = cantilever(ANGLE, 3.048, n)
    end = tip(matrices, held, n, fy=-100.0)[6 * n : 6 * n + 6, 0] * 1e3
    assert end[:2] == pytest.approx([-1.5707, -3.1032], rel=1e-3) and end[5] == pytest.approx(-5.739, rel=5e-3)
    assert frequencies(matrices, held, 5)[0] == pytest.approx([7.706, 11.29, 22.30, 40.3, 47.84], rel=4e-3)


def test_one_element_is_exact_under_end_loads():
    for p, load, k in ((CHANNEL, "fx", 0), (GIRDER, "fy", 1), (BAR, "fy", 1)):
        one, many = (tip(*cantilever(p, 2.0, n)[1:], n, **{load: -1.0})[6 * n + k, 0] for n in (1, 16))
        assert one == pytest.approx(many, rel=1e-9)
    short = 0.1
    u, _ = tip_under_force(BAR, STEEL, short, np.array([0.0, 1.0]))
    shear = 1.2 * short / (STEEL.youngs_pa / 2.6 * 4e-4)
    assert u[1] == pytest.approx(short**3 / (3 * STEEL.youngs_pa * 0.02**4 / 12) + shear, rel=1e-4)


def test_frequencies_of_a_slender_bar():
    n = 32
    _, matrices, held = cantilever(BAR, 4.0, n)
    found = frequencies(matrices, held, 6)[0]
    exact = [bending_frequency(BAR.i1, BAR, STEEL, 4.0, root) for root in CANTILEVER_ROOTS[:3]]
    assert found[::2] == pytest.approx(exact, rel=1e-3)
    free = frequencies(matrices, np.zeros_like(held), 10)[0]
    assert free[:6].max() < 1e-3 * free[6]
    assert free[6::2] == pytest.approx([bending_frequency(BAR.i1, BAR, STEEL, 4.0, root) for root in FREE_ROOTS[:2]], rel=1e-3)


def test_torsional_frequency_of_a_tube():
    """A tube does not warp: sqrt(GJ / rho I0) / 4L."""
    tube = properties_of("CHS", {"d": 0.1143, "t": 0.006})
    _, matrices, held = cantilever(tube, 1.0, 24)
    assert np.abs(frequencies(matrices, held, 6)[0] / torsional_frequency(tube, STEEL, 1.0) - 1).min() < 1e-3


@pytest.mark.parametrize(("p", "length"), CASES)
def test_buckling_of_a_cantilever(p, length):
    n = 24
    beams, matrices, held = cantilever(p, length, n)
    solution = tip(matrices, held, n, fz=-1.0)[:, 0]
    force = axial_forces(beams, matrices, solution)
    assert force == pytest.approx(-1.0)
    found = buckling(matrices, held, geometric(beams, force, matrices.dof, len(held)), 1)
    assert found[0] == pytest.approx(buckling_loads(p, STEEL, length)[0], rel=4e-3)  # the rest is shear
    assert len(buckling(matrices, held, geometric(beams, -force, matrices.dof, len(held)), 1)) == 0


def test_a_short_angle_twists_before_it_bends():
    """Below some length the flexural-torsional load of an angle stays at G J / r0^2 and the Euler load is far above."""
    short = 0.4
    loads = buckling_loads(ANGLE, STEEL, short)
    euler = math.pi**2 * STEEL.youngs_pa * ANGLE.i2 / (2 * short) ** 2
    torsion = STEEL.youngs_pa / 2.6 * ANGLE.j / ANGLE.polar_radius_squared
    assert loads[0] < 0.6 * euler and loads[0] == pytest.approx(torsion, rel=0.15)


def test_three_point_bending():
    p, length = GIRDER, 2.0
    beams = straight(length, p, STEEL, 24)
    matrices = assemble_beams(beams)
    held = np.zeros(len(matrices.stiffness), bool)
    held[[0, 1, 2, 5, 6 * 24, 6 * 24 + 1, 6 * 24 + 5]] = True
    load = np.zeros((len(held), 1))
    load[6 * 12 + 1] = -1e3
    found = solve_beams(matrices, held, load)[6 * 12 : 6 * 12 + 2, 0]
    assert found == pytest.approx(middle_deflection(p, STEEL, length, np.array([0.0, -1e3])), rel=1e-4, abs=1e-12)


def test_a_turned_frame_answers_alike():
    """A portal of two columns and a beam, turned in space: the same sway, the same frequencies."""

    def portal(rotation):
        nodes = np.array([[0, 0, 0], [0, 0, 1.5], [0, 0, 3], [1, 0, 3], [2, 0, 3], [2, 0, 1.5], [2, 0, 0]], float)
        elements = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 6]])
        along = nodes[elements[:, 1]] - nodes[elements[:, 0]]
        z = along / np.linalg.norm(along, axis=1)[:, None]
        y = np.tile([0.0, 1.0, 0.0], (6, 1))
        axes = np.stack([np.cross(y, z), y, z], axis=2)
        beams = dataclasses.replace(
            straight(1.0, CHANNEL, STEEL, 6), nodes=nodes @ rotation.T, elements=elements, axes=rotation @ axes, chain=np.array([0, 0, 1, 1, 2, 2])
        )
        matrices = assemble_beams(beams)
        held = np.zeros(len(matrices.stiffness), bool)
        held[:6] = held[36:42] = True
        load = np.zeros((len(held), 1))
        load[12:15, 0] = rotation @ [1e3, 200.0, 0]
        return rotation.T @ solve_beams(matrices, held, load)[12:15, 0], frequencies(matrices, held, 6)[0]

    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    straight_up, f0 = portal(np.eye(3))
    turned, f1 = portal(turn)
    assert turned == pytest.approx(straight_up, rel=1e-8) and f1 == pytest.approx(f0, rel=1e-8)


def test_messages():
    beams = straight(1.0, BAR, STEEL, 2)
    matrices = assemble_beams(beams)
    with pytest.raises(SolveError, match="can move freely"):
        solve_beams(matrices, np.zeros(len(matrices.stiffness), bool), np.ones((len(matrices.stiffness), 1)))
    with pytest.raises(SolveError, match="have no length"):
        assemble_beams(dataclasses.replace(beams, nodes=np.zeros((3, 3))))
