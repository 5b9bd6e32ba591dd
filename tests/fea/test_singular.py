"""Re-entrant edges: of the true surface, not of the chords that a smooth hole is made of."""

import numpy as np
import pytest

from fea.bars import l_bar
from scan2fea.fea import build_model
from scan2fea.fea.singular import edge_angles, singular_places
from scan2fea.types import TetMesh


def wall_of_a_hole(n, curved):
    """The wall of a hole of radius 1 and height 1, n chords round, two triangles each, outward of the material: towards the axis."""
    angle = np.pi * np.arange(2 * n) / n
    radius = np.where(np.arange(2 * n) % 2 == 0, 1.0, 1.0 if curved else np.cos(np.pi / n))
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    nodes = np.concatenate([np.column_stack([ring, np.full(2 * n, z)]) for z in (0.0, 0.5, 1.0)])
    at = lambda level, k: 2 * n * level + k % (2 * n)  # noqa: E731
    faces = []
    for k in range(0, 2 * n, 2):
        a, b, c, d = at(0, k), at(0, k + 2), at(2, k + 2), at(2, k)
        ab, bc, cd, da, ac = at(0, k + 1), at(1, k + 2), at(2, k + 1), at(1, k), at(1, k + 1)
        faces += [[a, c, b, ac, bc, ab], [a, d, c, da, cd, ac]]
    return TetMesh(
        nodes=nodes, tets=np.arange(10)[None], boundary=np.array(faces), face_tag=np.zeros(len(faces), np.int64), face_names=("HOLE",)
    )


@pytest.mark.parametrize("n", [6, 12, 24])
def test_a_smooth_hole_has_no_edges_whatever_it_is_made_of(n):
    flat = wall_of_a_hole(n, curved=False)
    order_1 = TetMesh(nodes=flat.nodes, tets=flat.tets[:, :4], boundary=flat.boundary[:, :3], face_tag=flat.face_tag, face_names=flat.face_names)
    for mesh in (flat, order_1):
        assert np.degrees(edge_angles(mesh)[1].min()) == pytest.approx(-360 / n)
    assert np.abs(np.degrees(edge_angles(wall_of_a_hole(n, curved=True))[1])).max() < 0.1 * 360 / n


def test_the_inner_edge_of_an_angle_is_one():
    model = build_model(l_bar(0.1, 0.01, 0.3, 3, 6))
    ends, turn = edge_angles(model.mesh)
    inner = ends[turn < -np.radians(80)]
    assert len(inner) and np.ptp(model.mesh.nodes[inner].reshape(-1, 3), axis=0)[:2].max() == 0
    assert set(inner.ravel()) <= set(singular_places(model).nodes)
