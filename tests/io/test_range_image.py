"""PLY files that are range images of a swept stripe: their grid tells where each point was seen from."""

import struct

import numpy as np
import pytest

from scan2fea.io import InputOptions, read_scan


def range_image(path, damaged=False, binary=False):
    """A swept image of 60 columns between empty ones and 40 rows, seen from (x, 0.1, 1.3); vertices not in the order of the cells."""
    row, column = (v.ravel() for v in np.mgrid[:40, :60])
    z = 0.04 * np.sin(0.2 * column + 0.1 * row)
    points = np.column_stack([1e-3 * column, 0.1 + (row - 12) * 0.003 * (1.3 - z), z]).astype("<f4" if binary else float)
    order = np.random.default_rng(3).permutation(len(points))
    cells = [[0] for _ in range(40 * 62)]
    for vertex, k in enumerate(order):
        cells[row[k] * 62 + column[k] + 1] = [1, vertex + (10**6 if damaged and vertex == 7 else 0)]
    head = f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\nobj_info num_cols 62\nobj_info num_rows 40\n"
    head += f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += f"element range_grid {len(cells)}\nproperty list uchar int vertex_indices\nend_header\n"
    if binary:
        body = points[order].tobytes() + b"".join(struct.pack("<B" + "i" * cell[0], *cell) for cell in cells)
        path.write_bytes(head.encode() + body)
    else:
        rows = [*points[order].tolist(), *cells]
        path.write_text(head + "".join(" ".join(repr(v) for v in line) + "\n" for line in rows))
    return path, points[order]


@pytest.mark.parametrize("binary", [False, True])
def test_a_range_image_tells_where_it_was_seen_from(binary, tmp_path):
    path, points = range_image(tmp_path / "a.ply", binary=binary)
    raw = read_scan(path)
    assert raw.sensor == "known" and len(raw.notes) == 1 and "range image" in raw.notes[0]
    expected = np.column_stack([points[:, 0], np.full(len(points), 0.1), np.full(len(points), 1.3)])
    np.testing.assert_allclose(raw.scan.sensors(), expected, atol=1e-4 if binary else 1e-9)
    scaled = read_scan(path, InputOptions(unit="mm"))
    np.testing.assert_allclose(scaled.scan.sensors(), 1e-3 * raw.scan.sensors(), rtol=1e-12)


def test_a_stated_place_goes_before_the_one_that_a_range_image_tells(tmp_path):
    path, _ = range_image(tmp_path / "a.ply")
    raw = read_scan(path, InputOptions(sensor_position=(0.0, 1.0, 2.0)))
    assert raw.notes == () and (raw.scan.sensors() == [0.0, 1.0, 2.0]).all()


def test_a_damaged_grid_leaves_the_points_as_they_are(tmp_path):
    path, points = range_image(tmp_path / "a.ply", damaged=True)
    raw = read_scan(path)
    assert (raw.sensor, raw.notes) == ("unknown", ()) and (raw.scan.cloud.points == points).all()
    cut = path.read_text().splitlines(keepends=True)[:-30]
    path.write_text("".join(cut))
    assert read_scan(path).sensor == "unknown"
