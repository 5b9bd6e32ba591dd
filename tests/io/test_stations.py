"""E57 and PTX: stations with poses, and rays that brought nothing back."""

import itertools

import numpy as np
import pytest

from scan2fea.io import read_scan
from scan2fea.io.gather import _Misses
from scan2fea.io.misses import grid_directions

POINTS = np.random.default_rng(11).normal(size=(40, 3)).round(4) + np.array([100, 200, 5])


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_e57_applies_poses_and_knows_sensors(tmp_path):
    import pye57

    with pye57.E57(str(tmp_path / "a.e57"), "w") as file:
        for k in range(2):
            local = POINTS - POINTS.mean(axis=0) + k
            data = {f"cartesian{axis}": local[:, i].copy() for i, axis in enumerate("XYZ")}
            half = 0.3 * (k + 1) / 2
            file.write_scan_raw(
                {**data, "intensity": np.arange(40.0)},
                rotation=np.array([np.cos(half), 0, 0, np.sin(half)]),
                translation=np.array([1.0, 2, 3]) * (k + 1),
            )
    raw = read_scan(tmp_path / "a.e57")
    assert (raw.n_points, raw.unit, raw.unit_source, raw.sensor, raw.pose_given) == (80, "m", "format", "known", True)
    expected = np.concatenate([(POINTS - POINTS.mean(axis=0) + k) @ turned(0.3 * (k + 1)).T + np.array([1.0, 2, 3]) * (k + 1) for k in range(2)])
    np.testing.assert_allclose(raw.scan.cloud.points, expected, atol=1e-6)  # pye57 writes float32
    np.testing.assert_allclose(raw.scan.sensors(), np.repeat([[1.0, 2, 3], [2.0, 4, 6]], 40, axis=0))
    assert raw.scan.cloud.raw_index.tolist() == list(range(80))


def swept(n_columns=24, n_rows=15):
    """Directions of a scanner that sweeps, column by column, and the room it sees: a box with an open side."""
    azimuth = np.repeat(np.linspace(-2.5, 3.2, n_columns), n_rows)
    elevation = np.tile(np.linspace(-0.9, 0.6, n_rows), n_columns)
    direction = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
    reach = np.min(np.where(direction != 0, 4.0 / np.abs(direction), np.inf), axis=1)
    is_miss = (direction[:, 0] * reach > 3.9) | (np.arange(len(reach)) % 37 == 0)
    return direction, reach, is_miss


def test_ptx_misses_get_their_directions_from_the_grid(tmp_path):
    direction, reach, is_miss = swept()
    local = np.where(is_miss[:, None], 0.0, direction * reach[:, None])
    rotation, origin = turned(0.7), np.array([10.0, 20.0, 1.5])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = rotation.T, origin  # rows are multiplied from the left
    head = "24\n15\n10 20 1.5\n" + "".join(" ".join(map(repr, row)) + "\n" for row in [*rotation.T.tolist(), *matrix.tolist()])
    block = head + "".join(f"{x!r} {y!r} {z!r} 0.5\n" for x, y, z in local.tolist())
    (tmp_path / "a.ptx").write_text(block + block)
    raw = read_scan(tmp_path / "a.ptx")
    n = int(is_miss.sum())
    assert (raw.n_points, raw.n_misses, raw.n_dropped, raw.sensor, raw.pose_given) == (720, 2 * n, 0, "known", True)
    expected = (direction * reach[:, None])[~is_miss] @ rotation.T + origin
    np.testing.assert_allclose(raw.scan.cloud.points[: len(expected)], expected, atol=1e-12)
    assert raw.scan.cloud.raw_index[: len(expected)].tolist() == np.flatnonzero(~is_miss).tolist()
    rays = raw.scan.rays
    missed = np.isnan(rays.range_m)
    assert missed.sum() == 2 * n and (rays.origin == origin).all()
    np.testing.assert_allclose(rays.direction[missed][:n], direction[is_miss] @ rotation.T, atol=1e-9)


@pytest.mark.parametrize("state", [1, 2])
def test_e57_misses_by_state_and_by_grid(state, tmp_path):
    import pye57

    direction, reach, is_miss = swept()
    local = direction * np.where(is_miss, 1.0 if state == 1 else 0.0, reach)[:, None]  # state 1: the direction is known; 2: nothing is
    data = {f"cartesian{axis}": local[:, k].copy() for k, axis in enumerate("XYZ")}
    order = np.arange(len(local))
    data |= {"rowIndex": order % 15, "columnIndex": order // 15, "cartesianInvalidState": (is_miss * state).astype(np.int8)}
    with pye57.E57(str(tmp_path / "a.e57"), "w") as file:
        file.write_scan_raw(data, rotation=np.array([np.cos(0.35), 0, 0, np.sin(0.35)]), translation=np.array([10.0, 20.0, 1.5]))
    raw = read_scan(tmp_path / "a.e57")
    assert (raw.n_points, raw.n_misses, raw.sensor) == (360, int(is_miss.sum()), "known")
    missed = np.isnan(raw.scan.rays.range_m)
    np.testing.assert_allclose(raw.scan.rays.direction[missed], direction[is_miss] @ turned(0.7).T, atol=1e-5)
    np.testing.assert_allclose(raw.scan.cloud.points, (direction * reach[:, None])[~is_miss] @ turned(0.7).T + [10, 20, 1.5], atol=1e-5)


def test_ptx_of_a_cloud_that_no_scanner_saw_has_no_sensor(tmp_path):
    rows = "".join(f"{x!r} {y!r} {z!r} 0\n" for x, y, z in (POINTS + 1e5).tolist())
    (tmp_path / "a.ptx").write_text("8\n5\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n" + rows)
    raw = read_scan(tmp_path / "a.ptx")
    assert raw.sensor == "unknown" and raw.n_points == 40 and not raw.pose_given


def test_e57_in_pieces_is_the_same(tmp_path, monkeypatch):
    """The angles of the grid come from the whole scan, though it is read piece by piece."""
    from scan2fea.io import e57

    test_e57_misses_by_state_and_by_grid(2, tmp_path)
    whole = read_scan(tmp_path / "a.e57")
    monkeypatch.setattr(e57, "ROWS_PER_PIECE", 37)
    parts = read_scan(tmp_path / "a.e57")
    assert parts.scan.cloud.points.tobytes() == whole.scan.cloud.points.tobytes()
    np.testing.assert_allclose(parts.scan.rays.direction, whole.scan.rays.direction, atol=1e-12)
    assert (parts.n_points, parts.n_misses) == (whole.n_points, whole.n_misses) and whole.n_misses > 0


@pytest.mark.parametrize("wrong", [-1, 10**12])
def test_grid_numbers_that_are_none_cost_no_memory(wrong):
    direction, reach, is_miss = swept()
    order = np.arange(len(reach))
    row, column = order % 15, order // 15
    assert grid_directions(direction * reach[:, None], ~is_miss, row, column) is not None
    assert grid_directions(direction * reach[:, None], ~is_miss, np.where(order == 3, wrong, row), column) is None


@pytest.mark.parametrize("sizes", [[5], [3, 0, 4], [1] * 40, [64], [30, 30, 30]])
def test_misses_beyond_the_budget_are_thinned_evenly(sizes):
    misses = _Misses(10)
    rows = np.cumsum([0, *sizes])
    for first, last in itertools.pairwise(rows):
        origin = np.arange(first, last, dtype=float)[:, None] * np.ones(3)
        misses.add(origin, -origin, 2 * origin[:, 0])
    origin, direction, time_s = misses.whole()
    step = 1
    while -(-sum(sizes) // step) > 10:
        step *= 2
    assert origin[:, 0].tolist() == list(range(0, sum(sizes), step)) and misses.step == step
    assert (direction == -origin).all() and (time_s == 2 * origin[:, 0]).all()
