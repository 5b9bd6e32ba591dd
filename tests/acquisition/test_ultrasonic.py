"""Ultrasonic logs: pings at a wall whose place is known exactly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.ultrasonic import from_ultrasonic, surface_of
from scan2fea.errors import FormatError, InputError

HALF = np.radians(15.0)


def _wall(n: int = 150, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pings along a wall at x = 1, the sensor turned at random within 10 degrees: the nearest place of the cone is square to the wall."""
    rng = np.random.default_rng(seed)
    origin = np.c_[np.zeros(n), np.linspace(0.0, 2.0, n), rng.uniform(-0.2, 0.2, n)]
    yaw, pitch = rng.uniform(-0.17, 0.17, (2, n))
    axis = np.c_[np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)]
    return origin, axis, 1.0 + rng.normal(0.0, 0.002, n)


def test_points_come_nearer_to_the_wall_than_those_on_the_axes() -> None:
    origin, axis, range_m = _wall()
    scan, _ = surface_of(origin, axis, range_m, HALF)
    np.testing.assert_allclose(np.linalg.norm(scan.cloud.points - origin, axis=1), range_m, rtol=1e-12)  # the distance is kept
    np.testing.assert_array_equal(scan.sensors(), origin)
    foot = origin + [1.0, 0.0, 0.0]  # where the echo came from
    ours = np.linalg.norm(scan.cloud.points - foot, axis=1)
    plain = np.linalg.norm(origin + axis * range_m[:, None] - foot, axis=1)
    assert np.median(ours) < 0.85 * np.median(plain)
    across = scan.cloud.sigma_across_m
    assert np.mean(ours <= 3.0 * np.hypot(across, scan.cloud.sigma_along_m)) > 0.94
    assert across.min() > 0.01  # still a large uncertainty beside the 2 mm of the range


def test_one_direction_alone_knows_nothing_across() -> None:
    """Pings from one place along one axis: the point lies on the axis, its spread is that of the cone, R tan(half) / 2."""
    origin, axis, range_m = np.zeros((5, 3)), np.tile([1.0, 0.0, 0.0], (5, 1)), np.full(5, 1.0)
    scan, cell = surface_of(origin, axis, range_m, HALF)
    np.testing.assert_allclose(scan.cloud.points, [[1.0, 0.0, 0.0]] * 5, atol=0.02)
    np.testing.assert_allclose(scan.cloud.sigma_across_m, np.hypot(np.sin(HALF) / 2, cell / 12**0.5), rtol=0.05)


def test_result_moves_with_the_log() -> None:
    origin, axis, range_m = _wall(60)
    shift = np.array([100.0, -30.0, 4.0])
    a, _ = surface_of(origin, axis, range_m, HALF)
    b, _ = surface_of(origin + shift, axis, range_m, HALF)
    np.testing.assert_allclose(b.cloud.points - shift, a.cloud.points, atol=1e-9)


def _log(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_forms_of_a_log_agree(tmp_path: Path) -> None:
    origin, axis, range_m = _wall(40)
    place = [f"{o[0]},{o[1]},{o[2]}" for o in origin.tolist()]
    yaw, pitch = np.degrees(np.arctan2(axis[:, 1], axis[:, 0])), np.degrees(np.arcsin(axis[:, 2]))
    rows = list(zip(place, axis, range_m, strict=True))
    a = _log(tmp_path / "a.csv", "x,y,z,dx,dy,dz,range_m", [f"{p},{d[0]},{d[1]},{d[2]},{r}" for p, d, r in rows])
    turned = [f"{p},{u},{v},{r},30" for p, u, v, r in zip(place, yaw, pitch, range_m, strict=True)]
    b = _log(tmp_path / "b.csv", "x,y,z,yaw_deg,pitch_deg,range_m,cone_deg", turned)
    speed = 331.3 * np.sqrt(1 + 20 / 273.15)
    c = _log(tmp_path / "c.csv", "x,y,z,dx,dy,dz,time_us", [f"{p},{d[0]},{d[1]},{d[2]},{2e6 * r / speed}" for p, d, r in rows])
    made = [from_ultrasonic(path, AcquisitionOptions()) for path in (a, b, c)]
    for other in made[1:]:
        np.testing.assert_allclose(other.frames[0].scan.cloud.points, made[0].frames[0].scan.cloud.points, atol=1e-6)
    assert "30 degrees were taken" in made[0].notes[0] and "taken" not in made[1].notes[0]


def test_pings_without_echo_are_left_out(tmp_path: Path) -> None:
    rows = ["0,0,0,1,0,0,1.0", "0,0.1,0,1,0,0,", "0,0.2,0,1,0,0,0", "0,0.3,0,1,0,0,1.0", "0,0.4,0,1,0,0,1.0"]
    made = from_ultrasonic(_log(tmp_path / "a.csv", "x,y,z,dx,dy,dz,range_m", rows), AcquisitionOptions())
    assert (made.how["n_pings"], made.how["n_echoes"], len(made.frames[0].scan.cloud)) == (5, 3, 3)


@pytest.mark.parametrize(
    ("header", "rows", "error", "says"),
    [
        ("x,y,range_m", ["0,0,1"], FormatError, "lacks z"),
        ("x,y,z,range_m", ["0,0,0,1"], FormatError, "no direction"),
        ("x,y,z,dx,dy,dz", ["0,0,0,1,0,0"], FormatError, "no range"),
        ("x,y,z,dx,dy,dz,range_m", ["0,0,0,1,0,0"], FormatError, "row 2: 6 values for 7 columns"),
        ("x,y,z,dx,dy,dz,range_m", ["0,0,0,1,0,far,1"], FormatError, "dz = 'far' is no number"),
        ("x,y,z,dx,dy,dz,range_m", ["0,0,0,1,0,0,0"] * 9, InputError, "0 of 9 pings have an echo"),
        ("x,y,z,dx,dy,dz,range_m", [], InputError, "holds no pings"),
    ],
)
def test_broken_logs_say_what_is_wrong(tmp_path: Path, header: str, rows: list[str], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        from_ultrasonic(_log(tmp_path / "log.csv", header, rows), AcquisitionOptions())
