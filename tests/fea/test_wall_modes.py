"""Modes of a member's walls are told from those of the member."""

from types import SimpleNamespace

import numpy as np
import pytest

from fea.bars import kuhn, quadratic, tagged
from predicates import rotation
from scan2fea.fea.member_cases import LAST, _beam_modes
from scan2fea.fea.surfaces import distortion, surface


def tube():
    """A square tube of 6 x 6 cells with walls of one cell, along z, and its upper end face."""
    at = np.linspace(-0.03, 0.03, 7)
    keep = np.ones((6, 6, 4), bool)
    keep[1:-1, 1:-1] = False
    nodes, tets = quadratic(*kuhn(keep, at, at, np.linspace(0, 0.2, 5)))
    mesh = tagged(nodes, tets)
    corners = np.asarray(mesh.nodes)[np.asarray(mesh.boundary)[:, :3], 2]
    return mesh, np.flatnonzero((corners > 0.2 - 1e-9).all(axis=1))


def test_rigid_motions_and_warping_keep_a_section_and_ovals_do_not() -> None:
    mesh, end = tube()
    nodes, R = np.asarray(mesh.nodes), rotation(3)
    x, y, _ = nodes.T
    zero = np.zeros_like(x)
    fields = {
        "moved": (np.stack([zero + 1, zero - 2, zero], axis=1), 0.0),
        "turned": (np.cross([0.3, -0.2, 0.9], nodes), 0.0),
        "warped": (np.stack([zero + 1, zero, 50 * x * y], axis=1), 0.0),
        "oval": (np.stack([x, -y, zero], axis=1), 1.0),
        "breathing": (np.stack([x, y, zero], axis=1), 1.0),
        "askew": (np.stack([y, x, zero], axis=1), 1.0),
    }
    face = surface(nodes @ R.T, np.asarray(mesh.boundary)[end])
    for name, (field, share) in fields.items():
        assert distortion(face, R[:, :2], field @ R.T) == pytest.approx(share, abs=1e-9), name
    assert distortion(face, R[:, :2], zero[:, None] * R[0]) == 0.0


def test_modes_of_a_beam_are_counted_without_those_of_its_walls() -> None:
    mesh, end = tube()
    x, y, z = np.asarray(mesh.nodes).T
    oval, bent = np.stack([x, -y, 0 * z], axis=1), np.stack([z**2, 0 * z, -2 * x * z], axis=1)
    shapes = np.stack([oval, bent, oval, bent])
    model = SimpleNamespace(mesh=mesh, surfaces={LAST: end})
    assert _beam_modes(model, np.eye(3)[:, :2], shapes) == {1: (0, True), 3: (1, True)}
    assert _beam_modes(SimpleNamespace(mesh=mesh, surfaces={}), np.eye(3)[:, :2], shapes) == {k: (k, True) for k in range(4)}


def test_a_section_that_changes_its_shape_is_not_held_against_theory() -> None:
    mesh, end = tube()
    x, y, z = np.asarray(mesh.nodes).T
    bent = np.stack([z**2, 0 * z, -2 * x * z], axis=1)
    oval = np.stack([x, -y, 0 * z], axis=1) * 0.2**2 / np.sqrt(np.mean((x**2 + y**2)[z > 0.2 - 1e-9]))  # at the end as large as the bending
    model = SimpleNamespace(mesh=mesh, surfaces={LAST: end})
    assert [_beam_modes(model, np.eye(3)[:, :2], (bent + k * oval)[None])[0] for k in (0.03, 0.1)] == [(0, True), (0, False)]
