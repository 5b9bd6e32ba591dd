"""Every kind of object: closed, manifold, without crossings, and of the volume, area, centroid and inertia of its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing
from scan2fea.errors import InputError
from scan2fea.kernel.measures import area, centroid, inertia, volume
from scan2fea.kernel.transforms import random_rotation, rigid
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed

HOLES = (("a", 0.055, 0.03, 0.009), ("a", 0.055, 0.09, 0.009), ("b", 0.07, 0.06, 0.012))
PLANE = {
    "L": {"a": 0.16, "b": 0.1, "t": 0.012, "length": 2.0},
    "I": {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092, "length": 1.5},
    "C": {"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01, "length": 1.4},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.006, "tf": 0.009, "length": 1.0},
    "RHS": {"h": 0.14, "b": 0.08, "t": 0.006, "length": 1.6},
    "rect": {"b": 0.1, "t": 0.01, "length": 0.7},
    "plate": {"b": 0.5, "t": 0.005, "length": 0.8},
    "box": {"x": 0.4, "y": 0.3, "z": 0.2},
    "girder": {"h": 0.4, "b": 0.2, "tw": 0.009, "tf": 0.015, "length": 1.2, "ts": 0.01, "bs": 0.07, "n_stiffeners": 3},
    "table": {"x": 1.2, "y": 0.8, "height": 0.72, "top": 0.03, "leg": 0.06, "inset": 0.05},
}
CURVED = {
    "CHS": {"d": 0.1, "t": 0.005, "length": 0.5},
    "round": {"d": 0.05, "length": 0.5},
    "cylinder": {"d": 0.3, "length": 0.4},
    "sphere": {"d": 0.3},
    "blob": {"d": 0.3, "wave": 0.3, "shape_seed": 5},
    "bracket": {"a": 0.1, "b": 0.12, "t": 0.01, "width": 0.12, "holes": HOLES},
    "tank": {"d": 0.3, "height": 0.3, "t": 0.012},
    "vessel": {"d": 0.3, "length": 0.9},
    "L": {**PLANE["L"], "fillet": 0.012},
    "I": {**PLANE["I"], "fillet": 0.012},
    "C": {**PLANE["C"], "fillet": 0.01},
    "T": {**PLANE["T"], "fillet": 0.008},
}


def off(mesh, exact):
    """Relative errors of volume, area and inertia, and of the centroid against the size."""
    size = float(np.ptp(mesh.vertices, axis=0).max())
    return {
        "volume": abs(volume(mesh) / exact.volume_m3 - 1),
        "area": abs(area(mesh) / exact.area_m2 - 1),
        "centroid": float(np.abs(centroid(mesh) - exact.centroid).max()) / size,
        "inertia": float(np.abs(inertia(mesh) - exact.inertia).max() / np.abs(exact.inertia).max()),
    }


@pytest.mark.parametrize("kind", PLANE)
def test_plane_shapes_are_exact(kind):
    shape = KINDS[kind].build(PLANE[kind], 1e-4)
    assert_closed_manifold_oriented(shape.mesh)
    assert_no_crossing(shape.mesh)
    assert shape.chord_m == 0
    assert max(off(shape.mesh, shape.exact).values()) < 1e-12
    T = rigid(random_rotation(4), [3.0, -2.0, 1.0])
    assert max(off(posed(shape.mesh, T), shape.exact.moved(T)).values()) < 1e-11


@pytest.mark.parametrize("kind", CURVED)
def test_curved_shapes_tend_to_their_closed_forms_with_the_chord(kind):
    """Every error falls in proportion to the chord tolerance: four times less for a quarter of it."""
    chords = (8e-4, 2e-4, 5e-5) if kind in ("cylinder", "vessel", "sphere", "blob", "tank") else (4e-4, 1e-4, 2.5e-5)
    made = [KINDS[kind].build(CURVED[kind], chord) for chord in chords]
    assert_closed_manifold_oriented(made[0].mesh)
    assert_closed_manifold_oriented(made[-1].mesh)
    assert_no_crossing(made[0].mesh)
    for name in ("volume", "inertia"):
        errors = [off(shape.mesh, shape.exact)[name] for shape in made]
        assert np.polyfit(np.log(chords), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.3), (name, errors)
    finest = off(made[-1].mesh, made[-1].exact)
    size = float(np.ptp(made[-1].mesh.vertices, axis=0).min())
    assert finest["volume"] < 12 * chords[-1] / size
    assert finest["area"] < 12 * chords[-1] / size


def test_the_parameters_name_every_dimension_a_probe_measures():
    for kind, values in {**CURVED, **PLANE}.items():
        shape = KINDS[kind].build(values, 1e-4)
        for probe in shape.probes:
            name = probe.name.rstrip("*")
            assert probe.size_m == pytest.approx(shape.parameters[name], rel=1e-12), (kind, name)
            assert np.linalg.norm(probe.direction) == pytest.approx(1)


@pytest.mark.parametrize("kind", [k for k in {**CURVED, **PLANE} if k != "blob"])
def test_probes_run_through_the_solid(kind):
    """A line through each probe leaves the mesh at half the dimension on both sides of the middle (outermost for a hollow)."""
    from scan2fea.kernel.rays import first_hits, scene_of

    shape = KINDS[kind].build({**CURVED, **PLANE}[kind], 5e-5)
    scene = scene_of(shape.mesh)
    side = np.array([1.7e-6, 1.1e-6, 0.7e-6])
    for probe in shape.probes:
        for sign in (1, -1):
            start = probe.middle + side
            if probe.name.endswith("*"):
                start = start + sign * probe.direction * probe.size_m
                t, _ = first_hits(scene, start[None], -sign * probe.direction[None])
            else:
                t, _ = first_hits(scene, start[None], sign * probe.direction[None])
            assert t[0] == pytest.approx(probe.size_m / 2, abs=2e-4), (probe.name, probe.middle)


def test_a_blob_has_the_moments_of_its_formula_by_quadrature():
    from scan2fea.kernel.construction import evaluated
    from scan2fea.simulation.closed_forms import star

    radius = {(0, 0, 0): 0.2, (1, 0, 0): 0.03, (0, 2, 1): -0.05, (1, 1, 1): 0.04, (0, 0, 3): 0.02}
    z, w = np.polynomial.legendre.leggauss(40)
    a = 2 * np.pi * np.arange(80) / 80
    zz, aa = (g.ravel() for g in np.meshgrid(z, a, indexing="ij"))
    u = np.stack([np.sqrt(1 - zz**2) * np.cos(aa), np.sqrt(1 - zz**2) * np.sin(aa), zz], 1)
    weight = np.repeat(w, 80) * 2 * np.pi / 80
    r = evaluated(radius, u)
    exact = star(radius)
    assert exact.volume_m3 == pytest.approx(weight @ r**3 / 3, rel=1e-13)
    np.testing.assert_allclose(exact.first, (weight * r**4 / 4) @ u, rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(exact.second, np.einsum("n,ni,nj->ij", weight * r**5 / 5, u, u), rtol=1e-12, atol=1e-16)


def test_fillets_add_their_spandrels():
    plain, round_ = (KINDS["I"].build({**PLANE["I"], **more}, 1e-5).exact for more in ({}, {"fillet": 0.012}))
    assert round_.volume_m3 - plain.volume_m3 == pytest.approx(4 * (1 - math.pi / 4) * 0.012**2 * 1.5, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "change", "says"),
    [
        ("L", {"t": 0.1}, "t is 0.1 m; it must be less than 0.1"),
        ("I", {"tf": 0.11}, "tf"),
        ("RHS", {"t": 0.04}, "t is 0.04"),
        ("I", {"fillet": 0.052}, "fillet is 0.052 m; it must be less than 0.052"),
        ("girder", {"bs": 0.0955}, "bs is 0.0955"),
        ("girder", {"ts": 0.3}, "ts is 0.3"),
        ("sphere", {"d": -1.0}, "must be positive"),
        ("blob", {"wave": 0.51}, "wave is 0.51"),
        ("vessel", {"length": 0.15}, "two heads"),
        ("tank", {"t": 0.075}, "wall"),
    ],
)
def test_limits_are_refused_on_the_limit(kind, change, says):
    with pytest.raises(InputError, match=says):
        KINDS[kind].build({**CURVED.get(kind, {}), **PLANE.get(kind, {}), **change}, 1e-4)
