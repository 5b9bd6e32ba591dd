"""Frequencies of beams near a solved one."""

import numpy as np
import pytest

from scan2fea.errors import SolveError
from scan2fea.fea import material
from scan2fea.fea.beam import assemble_beams, frequencies, straight
from scan2fea.fea.near_beam import NearBeams
from scan2fea.fea.section_properties import properties_of

STEEL = material("S235")


def solved(p, length):
    matrices = assemble_beams(straight(length, p, STEEL, 12))
    return frequencies(matrices, np.zeros(len(matrices.stiffness), bool), 10)[0][6:]


@pytest.mark.parametrize(("family", "values", "length"), [
    ("L", {"a": 0.127, "b": 0.1, "t": 0.00635}, 3.0), ("I", {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085}, 2.0),
    ("round", {"d": 0.05}, 0.4)])  # fmt: skip
def test_the_error_is_of_second_order(family, values, length):
    """Exact at the base; with a wall a tenth thicker and a length 2 % longer within 0.1 %, and never below (Ritz)."""
    base = properties_of(family, values, level=0)
    near = NearBeams(base, STEEL, length, 12)
    assert near.frequencies(base, length, 10)[6:] == pytest.approx(solved(base, length), rel=1e-9)
    wall = min(values, key=values.get)
    other = properties_of(family, {**values, wall: 1.1 * values[wall]}, level=0)
    found, exact = near.frequencies(other, 1.02 * length, 10)[6:], solved(other, 1.02 * length)
    assert found == pytest.approx(exact, rel=1e-3)
    assert (found >= exact * (1 - 1e-9)).all()
    assert (np.abs(solved(base, length) / exact - 1) > 0.01).any()


def test_a_beam_without_length_is_refused():
    base = properties_of("round", {"d": 0.05}, level=0)
    with pytest.raises(SolveError, match="length"):
        NearBeams(base, STEEL, 1.0, 12).frequencies(base, -1.0, 10)
