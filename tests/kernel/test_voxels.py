"""Voxel means against the definition, and the stream against the batch."""

import numpy as np
import pytest

from scan2fea.errors import InputError, UsageError
from scan2fea.kernel.voxel_parts import cells_by_parts
from scan2fea.kernel.voxels import VoxelStream, voxel_mean


def by_definition(points, edge):
    """Cells by a dictionary: first row, rows."""
    cells = {}
    for row, p in enumerate(points):
        cells.setdefault(tuple(np.floor(p / edge)), []).append(row)
    return list(cells.values())


@pytest.mark.parametrize("scale, offset", [(1.0, 0.0), (1e-3, 0.0), (100.0, 0.0), (1.0, 4.5e6)])
def test_equals_definition(scale, offset):
    points = np.random.default_rng(1).normal(size=(2000, 3)) * scale + offset
    edge = 0.3 * scale
    got, expected = voxel_mean(points, edge), by_definition(points, edge)
    assert got.n_cells == len(expected)
    assert got.first_row.tolist() == [rows[0] for rows in expected]
    assert got.count.tolist() == [len(rows) for rows in expected]
    for cell, rows in enumerate(expected):
        assert (got.cell_of_point[rows] == cell).all()
        offset_mean = (points[rows] - points[rows[0]]).mean(axis=0)
        assert np.abs(got.mean[cell] - points[rows[0]] - offset_mean).max() <= 4e-16 * (abs(offset) + 4 * scale)


def test_points_on_the_borders_belong_to_the_upper_cell():
    x = np.array([0.0, 0.25, 0.5, -0.0, -0.25, np.nextafter(0.25, 0), np.nextafter(0, -1)])
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    assert voxel_mean(points, 0.25).cell_of_point.tolist() == [0, 1, 2, 0, 3, 0, 3]


def test_order_of_points_changes_numbers_only():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(3000, 3))
    order = rng.permutation(len(points))
    a, b = voxel_mean(points, 0.5), voxel_mean(points[order], 0.5)
    assert a.n_cells == b.n_cells
    np.testing.assert_allclose(a.mean[a.cell_of_point[order]], b.mean[b.cell_of_point], atol=1e-13)


@pytest.mark.parametrize("pieces", [1, 2, 7, 999])
def test_stream_gives_the_bytes_of_the_batch(pieces):
    points = np.random.default_rng(3).normal(size=(20000, 3)) + 1e5
    batch, stream = voxel_mean(points, 0.05), VoxelStream(0.05)
    cells = np.concatenate([stream.add(part) for part in np.array_split(points, pieces)])
    for a, b in ((cells, batch.cell_of_point), (stream.mean(), batch.mean), (stream.first_row(), batch.first_row), (stream.count(), batch.count)):
        assert a.tobytes() == b.tobytes()


def test_coarsened_stream_has_the_cells_of_the_double_edge():
    points = np.random.default_rng(4).normal(size=(20000, 3)) - 7e3
    stream = VoxelStream(0.01)
    cells = stream.add(points[:9000])
    merged = stream.coarsen()
    cells = np.concatenate([merged[cells], stream.add(points[9000:])])
    cells = stream.coarsen()[cells]
    batch = voxel_mean(points, 0.04)
    assert stream.edge_m == 0.04
    assert (cells == batch.cell_of_point).all()
    assert (stream.first_row() == batch.first_row).all()
    assert (stream.count() == batch.count).all()
    np.testing.assert_allclose(stream.mean(), batch.mean, rtol=0, atol=1e-11)


def test_one_cell_and_none():
    assert voxel_mean(np.zeros((0, 3)), 1.0).n_cells == 0
    equal = voxel_mean(np.full((5, 3), 0.7), 1.0)
    assert equal.mean.tolist() == [[0.7, 0.7, 0.7]] and equal.count.tolist() == [5]


def test_input_is_not_changed():
    points = np.random.default_rng(5).normal(size=(100, 3))
    before = points.copy()
    voxel_mean(points, 0.1)
    assert (points == before).all()


@pytest.mark.parametrize("edge", [0.0, -1.0, np.nan, np.inf])
def test_refuses_an_edge(edge):
    with pytest.raises(UsageError, match="voxel edge"):
        voxel_mean(np.zeros((1, 3)), edge)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2.0**52, -(2.0**52)])
def test_refuses_a_coordinate(value):
    with pytest.raises(InputError, match="larger voxels"):
        voxel_mean(np.array([[0.0, value, 0.0]]), 1.0)


@pytest.mark.parametrize("edge, n", [(0.002, 140_000), (0.3, 140_000), (1e3, 140_000), (0.05, 40_000), (0.05, 1)])
def test_by_parts_gives_the_bytes_of_the_stream(edge, n):
    """From own cells for most rows to eight cells for all, at the numbers of rows where parts begin to be."""
    points = np.random.default_rng(6).normal(size=(n, 3)) - 1e3 * (edge > 1)
    stream = VoxelStream(edge)
    cells = stream.add(points)
    expected = (cells, stream.mean(), stream.first_row(), stream.count())
    for a, b in zip(cells_by_parts(points, edge), expected, strict=True):
        assert a.dtype == b.dtype and a.tobytes() == b.tobytes()
    if n >= 2**17:
        batch = voxel_mean(points, edge)
        for a, b in zip((batch.cell_of_point, batch.mean, batch.first_row, batch.count), expected, strict=True):
            assert a.tobytes() == b.tobytes()
