"""Of scans beyond `input.memory_gib` one point a voxel is kept while they are read."""

import re

import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.io import InputOptions, read_scan
from scan2fea.io.ply_writer import write_mesh_ply
from scan2fea.io.scan import BYTES_PER_FACE
from scan2fea.types import TriangleMesh


def dense(n, offset=0.0):
    rng = np.random.default_rng(3)
    return np.column_stack([rng.random((n, 2)) * 10, rng.normal(size=n) * 0.001]) + offset


def test_of_a_scan_beyond_the_budget_one_point_a_voxel_is_kept(tmp_path):
    from scan2fea.io.gather import gather
    from scan2fea.io.source import Piece
    from scan2fea.kernel.voxels import voxel_mean

    points, limit = dense(60_000, 1e4), 5000
    label = np.arange(60_000)

    def pieces():
        for part in np.array_split(np.arange(60_000), 13):
            yield Piece(points=points[part], columns={"label": label[part]}, sensor=np.array([0.0, 0, 9e3]))

    found = gather(tmp_path, pieces, ("label",), 1.0, limit, keep_rows=False)
    assert limit // 3 < len(found.points) <= limit and found.n_rows == 60_000
    batch = voxel_mean(points, found.voxel_edge_m)
    assert found.points.tobytes() == points[batch.first_row].tobytes()  # read again at the final edge: the rows of the batch
    assert (found.raw_index == batch.first_row).all() and (found.columns["label"] == batch.first_row).all()
    ray, rays = found.rays()
    assert len(ray) == len(found.points) and (rays.origin == [0, 0, 9e3]).all()
    again = gather(tmp_path, pieces, ("label",), 1.0, limit, keep_rows=False)
    assert again.points.tobytes() == found.points.tobytes() and again.voxel_edge_m == found.voxel_edge_m


def test_thinning_is_told(tmp_path):
    np.save(tmp_path / "a.npy", dense(400_000))
    raw = read_scan(tmp_path / "a.npy", InputOptions(memory_gib=0.1))
    assert raw.n_points == 400_000 and len(raw.scan.cloud) < 0.1 * 2**30 / 250 and raw.voxel_edge_m > 0
    assert "exceed the 350896 that fit into input.memory_gib: read as one point in each of" in raw.notes[0]


def test_budget_is_inclusive(tmp_path):
    np.save(tmp_path / "a.npy", dense(350_896))
    assert read_scan(tmp_path / "a.npy", InputOptions(memory_gib=0.1)).voxel_edge_m is None
    np.save(tmp_path / "b.npy", dense(350_897))
    assert read_scan(tmp_path / "b.npy", InputOptions(memory_gib=0.1)).voxel_edge_m is not None


def test_a_surface_of_more_faces_than_fit_is_refused_with_both_numbers(tmp_path):
    limit = int(0.1 * 2**30 / BYTES_PER_FACE)
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    for n in (limit, limit + 1):
        write_mesh_ply(tmp_path / f"{n}.ply", TriangleMesh(vertices=vertices, faces=np.tile([0, 1, 2], (n, 1))))
    assert len(read_scan(tmp_path / f"{limit}.ply", InputOptions(memory_gib=0.1)).mesh.faces) == limit
    says = f"{limit + 1}.ply has {limit + 1} faces, {limit} fit into input.memory_gib: raise it, or simplify the surface"
    with pytest.raises(InputError, match=re.escape(says)):
        read_scan(tmp_path / f"{limit + 1}.ply", InputOptions(memory_gib=0.1))
