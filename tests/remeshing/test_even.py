"""Even triangles on drawn surfaces: the shape stays, faces are even, and true faces can be told from them."""

import numpy as np
import pytest

from predicates import rotation
from scan2fea.cad import true_solid
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import surface_topology
from scan2fea.remeshing import chord_height, evened, looks_drawn
from scan2fea.types import TriangleMesh

N, R, HOLE, HIGH = 48, 0.05, 0.03, 0.04


def ring(n=N):
    """A ring as CAD programs write it: each wall in n chords of two triangles."""
    turn = 2 * np.pi * np.arange(n) / n
    unit = np.c_[np.cos(turn), np.sin(turn)]
    flat = np.concatenate([R * unit, HOLE * unit])
    vertices = np.concatenate([np.c_[flat, np.zeros(2 * n)], np.c_[flat, np.full(2 * n, HIGH)]])
    a, b = np.arange(n), (np.arange(n) + 1) % n
    low_out, low_in, top_out, top_in = (np.stack([a, b]) + k * n for k in range(4))
    quads = [(low_out[0], low_out[1], top_out[1], top_out[0]), (low_in[1], low_in[0], top_in[0], top_in[1])]
    quads += [(low_out[1], low_out[0], low_in[0], low_in[1]), (top_out[0], top_out[1], top_in[1], top_in[0])]
    faces = [np.stack(f, axis=1) for q in quads for f in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    return TriangleMesh(vertices=vertices, faces=np.concatenate(faces))


@pytest.mark.parametrize("n", [24, 48, 96])
def test_the_height_of_a_chord_is_that_of_its_circle(n) -> None:
    assert chord_height(ring(n)) == pytest.approx(R * (1 - np.cos(np.pi / n)), rel=0.02)


def test_planes_alone_have_no_chords_and_turning_or_scaling_changes_nothing() -> None:
    square = ring(4)
    assert chord_height(square) == 0.0 and looks_drawn(square)
    mesh = ring()
    turned = TriangleMesh(vertices=3 * mesh.vertices @ rotation(5).T + 1.0, faces=mesh.faces)
    assert chord_height(turned) == pytest.approx(3 * chord_height(mesh), rel=1e-6) and looks_drawn(turned)


def test_the_even_triangles_of_a_scan_are_no_drawing() -> None:
    even = evened(ring(), 6_000).mesh
    rng = np.random.default_rng(0)
    scanned = TriangleMesh(vertices=even.vertices + 2e-4 * rng.standard_normal(even.vertices.shape), faces=even.faces)
    assert not looks_drawn(scanned)


def test_true_faces_are_told_from_chords_in_even_triangles() -> None:
    mesh = ring()
    before = mesh.vertices.copy()
    found = evened(mesh, 6_000)
    assert np.array_equal(mesh.vertices, before)
    assert surface_topology(found.mesh).is_clean and 4_000 < len(found.mesh.faces) < 12_000
    assert np.quantile(triangle_quality(found.mesh.vertices, found.mesh.faces)["min_angle_deg"], 0.05) > 20
    assert PointToMesh(mesh).nearest(found.mesh.vertices).distance.max() < found.chord_m
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=2e-3)
    solid = true_solid(found.mesh, found.mesh.vertices, spacing_m=found.edge_m, noise_m=found.chord_m)
    assert solid.brep is not None, solid.reason
    assert sorted(solid.brep.face_kinds) == ["cylinder", "cylinder", "plane", "plane"]
    assert solid.brep.volume_m3 == pytest.approx(np.pi * (R**2 - HOLE**2) * HIGH, rel=4e-3)
