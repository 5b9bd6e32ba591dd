from importlib import import_module

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing, rotation, sphere
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.reconstruction.poisson import indicator_surface, supported
from scan2fea.simulation.shapes import box
from scan2fea.types import TriangleMesh
from scanned import scanned


def on_torus(n, seed=0):
    """Points spread evenly over a torus of radii 1 and 0.4, and their normals."""
    rng = np.random.default_rng(seed)
    s, t, u = rng.uniform(0, 2 * np.pi, (3, 4 * n))
    keep = np.flatnonzero(u < 2 * np.pi * (1 + 0.4 * np.cos(t)) / 1.4)[:n]
    s, t = s[keep], t[keep]
    normals = np.stack([np.cos(s) * np.cos(t), np.sin(s) * np.cos(t), np.sin(t)], axis=1)
    return np.stack([np.cos(s), np.sin(s), 0 * s], axis=1) + 0.4 * normals, normals


def test_a_torus_keeps_volume_and_hole_wherever_it_lies():
    points, normals = on_torus(3000)
    turn, shift = rotation(3), np.array([5e5, 5e6, 100.0])
    for scale in (1.0, 1e-3):
        mesh, _ = indicator_surface(scale * points @ turn.T + shift, normals @ turn.T, scale * 0.08)
        found = surface_topology(mesh)
        assert_closed_manifold_oriented(mesh)
        assert (found.n_components, found.n_handles) == (1, 1)
        around = TriangleMesh(vertices=mesh.vertices - shift, faces=mesh.faces)
        assert volume(around) == pytest.approx(2 * np.pi**2 * 0.4**2 * scale**3, rel=0.01)


def test_two_runs_give_the_same_bytes_and_turned_normals_the_inside_out():
    points, normals = on_torus(2000)
    first, depth = indicator_surface(points, normals, 0.1)
    again, _ = indicator_surface(points, normals, 0.1)
    assert first.vertices.tobytes() == again.vertices.tobytes() and first.faces.tobytes() == again.faces.tobytes()
    assert 2.8 * 1.76 / 2**depth <= 0.1
    assert volume(indicator_surface(points, -normals, 0.1)[0]) < 0


def test_shells_without_points_go_and_voids_are_no_parts():
    solid, cavity, far = sphere(1.0, 2), sphere(0.5, 2), sphere(0.2, 2)
    meshes = [(solid, 0.0, 1), (cavity, 0.0, -1), (far, 9.0, 1)]
    start = np.cumsum([0, *(len(m.vertices) for m, _, _ in meshes)])
    mesh = TriangleMesh(
        vertices=np.concatenate([m.vertices + [x, 0, 0] for m, x, _ in meshes]),
        faces=np.concatenate([m.faces[:, ::way] + first for (m, _, way), first in zip(meshes, start, strict=False)]),
    )
    kept, n_dropped, n_parts = supported(mesh, np.concatenate([solid.vertices, cavity.vertices]))
    assert (n_dropped, n_parts) == (1, 1)
    assert volume(kept) == pytest.approx(volume(solid) - volume(cavity), rel=1e-12)
    assert supported(mesh, mesh.vertices)[1:] == (0, 2)


def test_a_block_is_closed_and_judged():
    truth = box(0.3, 0.2, 0.1)
    scan, _, _ = scanned(truth, 0.012, 0.0, seed=1)
    found = reconstruct(scan, ReconstructionOptions(method="poisson"))
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert volume(found.mesh) == pytest.approx(0.006, rel=0.02)
    assert found.how["method"] == "poisson" and {"parts", "deviation p95"} <= {check.name for check in found.checks}


def test_an_open_surface_is_refused(monkeypatch):
    def pierced(*given):
        mesh, depth = indicator_surface(*given)
        return TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[1:]), depth

    monkeypatch.setattr(import_module("scan2fea.reconstruction.poisson"), "indicator_surface", pierced)  # the function of that name hides it
    scan, _, _ = scanned(box(0.3, 0.2, 0.1), 0.02, 0.0, seed=1)
    with pytest.raises(ReconstructionError, match=r" 3 open edges .*limit 0: use reconstruction.method = visibility"):
        reconstruct(scan, ReconstructionOptions(method="poisson"))
