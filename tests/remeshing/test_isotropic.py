"""Split, collapse, flip, smooth: shape, size, creases, topology, and nothing that crosses."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing, box, l_beam, moved, rotation, sphere, torus, two_sided
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import surface_topology
from scan2fea.remeshing.isotropic import Guide, closed, crease_guide, isotropic, opened, sharp_edges
from scan2fea.types import TriangleMesh


def remeshed(mesh, edge, drift, angle_deg=40.0, rounds=6):
    sharp = sharp_edges(mesh, angle_deg)
    guide = Guide(surface=PointToMesh(mesh), creases=crease_guide(mesh, sharp), planes={}, drift_m=drift)
    work, trouble = isotropic(opened(mesh, sharp, np.full(len(mesh.vertices), edge)), guide, rounds)
    out = closed(work)
    assert_closed_manifold_oriented(out)
    assert_no_crossing(out)
    return out, trouble


def angles(mesh):
    return triangle_quality(mesh.vertices, mesh.faces)["min_angle_deg"]


def euler(mesh):
    return len(mesh.vertices) - len(mesh.faces) // 2


@pytest.mark.parametrize(("mesh", "edge"), [(sphere(rounds=4), 0.2), (torus(n=120, m=40), 0.12), (sphere(rounds=2), 0.1)])
def test_smooth_solids(mesh, edge):
    out, trouble = remeshed(mesh, edge, 0.02)
    length = np.linalg.norm(out.vertices[out.faces[:, 0]] - out.vertices[out.faces[:, 1]], axis=1)
    assert np.median(length) == pytest.approx(edge, rel=0.2)
    assert angles(out).min() > 25 and np.median(angles(out)) > 48
    assert euler(out) == euler(mesh) and not trouble
    assert max(d.max() for d in two_sided(out, mesh)) < 0.025
    assert (mesh.vertices == PointToMesh(mesh).nearest(mesh.vertices).closest).mean() > 0.5  # the input was not moved


def test_creases_and_corners_stay_exactly():
    mesh = l_beam(pitch=0.01)
    out, _ = remeshed(mesh, 0.012, 1e-4)
    assert volume(out) == pytest.approx(volume(mesh), rel=1e-12)
    assert max(d.max() for d in two_sided(out, mesh)) < 1e-14
    a, t = 0.127, 0.00635
    corners = [[x, y, z] for x, y in ((0, 0), (a, 0), (a, t), (t, t), (t, a), (0, a)) for z in (0, 0.5)]
    assert all((np.abs(out.vertices - c).max(1) < 1e-12).any() for c in corners)
    assert angles(out).min() > 20


def test_needles_of_a_coarse_solid_become_even():
    out, _ = remeshed(l_beam(length=1.0), 0.02, 1e-4)
    assert volume(out) == pytest.approx(volume(l_beam(length=1.0)), rel=1e-12)
    assert np.percentile(angles(out), 1) > 20


def test_a_thin_shell_does_not_cross_itself():
    """Walls a third of the edge apart."""
    outer = sphere(rounds=4)
    plate = TriangleMesh(vertices=outer.vertices * [1, 1, 0.03], faces=outer.faces)
    out, _ = remeshed(plate, 0.15, 0.005)  # which asserts that nothing crosses
    assert volume(out) == pytest.approx(volume(plate), rel=0.05)


def test_noise_is_no_reason_to_fail():
    mesh = sphere(rounds=5)
    noisy = TriangleMesh(vertices=mesh.vertices + np.random.default_rng(0).normal(0, 0.003, mesh.vertices.shape), faces=mesh.faces)
    out, _ = remeshed(noisy, 0.08, 0.01, angle_deg=180)
    assert angles(out).min() > 20
    assert volume(out) == pytest.approx(volume(mesh), rel=0.01)


def test_rigid_motion_keeps_the_result():
    mesh, R, shift = sphere(rounds=3), rotation(5), np.array([10.0, 20, 30])
    here, _ = remeshed(mesh, 0.3, 0.02)
    there, _ = remeshed(moved(mesh, R, shift), 0.3, 0.02)
    assert abs(len(here.faces) - len(there.faces)) < 0.1 * len(here.faces)
    assert max(d.max() for d in two_sided(moved(here, R, shift), there)) < 0.03


def test_same_bytes_twice():
    a, b = (remeshed(torus(), 0.1, 0.01)[0] for _ in range(2))
    assert (a.vertices == b.vertices).all() and (a.faces == b.faces).all()


def test_no_rounds_change_nothing():
    mesh = box(pitch=0.2)
    out, _ = remeshed(mesh, 0.3, 0.01, rounds=0)
    assert (out.vertices == mesh.vertices).all() and (out.faces == mesh.faces).all()
    assert surface_topology(out).is_clean
