"""Stereo: rendered pairs with exact depths, the chessboards and the Aloe pair of SCAN2FEA_DATA."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import map_coordinates

import real_scans
import rendered
from scan2fea.acquisition.cameras import Camera, Rig, read_camera, read_rig, write_rig
from scan2fea.acquisition.chessboard import board_of, calibrate
from scan2fea.acquisition.disparity import disparity, filled, sgbm, sgbm_right
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.stereo import from_stereo, span
from scan2fea.errors import FormatError, InputError, UsageError
from scan2fea.kernel.transforms import inverse

DATA = real_scans.DATA / "photogrammetry"
K = np.array([[500.0, 0.0, 199.5], [0.0, 500.0, 149.5], [0.0, 0.0, 1.0]])
SIZE = (400, 300)


def _save(path: Path, picture: np.ndarray) -> Path:
    Image.fromarray(picture).save(path)
    return path


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path, rendered.View]:
    """Left and right picture, calibration, and the left view; the right camera is turned and shifted along all axes."""
    folder = tmp_path_factory.mktemp("pair")
    left = rendered.render(K, SIZE, rendered.pose((-0.1, 0.0, 0.0)), seed=1)
    right = rendered.render(K, SIZE, rendered.pose((0.15, 0.03, 0.02), (0.1, 0.0, 3.5)), seed=2)
    T = inverse(right.T_world_camera) @ left.T_world_camera
    camera = Camera(K=K, distortion=np.zeros(5))
    rig = Rig(left=camera, right=camera, R=T[:3, :3], t=T[:3, 3], size=SIZE, unit_source="format", rms_px=0.1)
    (folder / "rig.json").write_text(write_rig(rig))
    paths = [_save(folder / "left.png", left.colour), _save(folder / "right.png", right.colour)]
    return paths, folder / "rig.json", left


def test_points_lie_on_the_rendered_surfaces_within_their_sigma(pair: tuple[list[Path], Path, rendered.View]) -> None:
    paths, calibration, view = pair
    made = from_stereo(paths, AcquisitionOptions(calibration=str(calibration)))
    scan = made.frames[0].scan
    points = scan.cloud.points
    assert len(points) > 0.75 * SIZE[0] * SIZE[1]
    assert made.unit_source == "format"
    np.testing.assert_allclose(scan.sensors(), 0.0)
    pixel = points @ K.T
    pixel = pixel[:, :2] / pixel[:, 2:]
    true = map_coordinates(view.depth, [pixel[:, 1], pixel[:, 0]], order=1, mode="nearest")
    error = np.linalg.norm(points, axis=1) * (1.0 - true / points[:, 2])
    baseline = made.how["baseline_m"]
    px = np.abs(error) * K[0, 0] * baseline / np.linalg.norm(points, axis=1) / points[:, 2]
    assert np.median(px) < 0.06 and np.percentile(px, 90) < 0.25
    ratio = np.abs(error) / scan.cloud.sigma_along_m
    assert np.mean(ratio <= 1.0) > 0.55 and np.mean(ratio <= 3.0) > 0.93
    np.testing.assert_allclose(scan.cloud.sigma_across_m, points[:, 2] / K[0, 0] / np.sqrt(12), rtol=0.1)


def test_scale_of_the_rig_is_the_scale_of_the_points(pair: tuple[list[Path], Path, rendered.View], tmp_path: Path) -> None:
    paths, calibration, _ = pair
    tree = json.loads(calibration.read_text())
    tree["T_m"] = [2.0 * t for t in tree["T_m"]]
    (tmp_path / "twice.json").write_text(json.dumps(tree))
    one, two = (from_stereo(paths, AcquisitionOptions(calibration=str(c))).frames[0].scan.cloud for c in (calibration, tmp_path / "twice.json"))
    np.testing.assert_allclose(two.points, 2.0 * one.points, rtol=1e-9)
    np.testing.assert_allclose(two.sigma_along_m, 2.0 * one.sigma_along_m, rtol=1e-9)


def test_known_shift_is_found_to_a_twentieth_of_a_pixel() -> None:
    texture = np.random.default_rng(0).normal(size=(120, 260))
    fine = np.fft.fft2(texture)
    fx, fy = np.fft.fftfreq(260)[None, :], np.fft.fftfreq(120)[:, None]
    fine = fine * np.exp(-((fx**2 + fy**2) / 0.02))
    pictures = [np.real(np.fft.ifft2(fine * np.exp(-2j * np.pi * fx * s))) for s in (0.0, -7.3)]
    pictures = [np.clip(128 + 50 * p / p.std(), 0, 255).astype(np.uint8) for p in pictures]
    found = disparity(pictures[0], pictures[1], 0.0, 16.0)
    inner = found.px[10:-10, 30:-10]
    assert np.isfinite(inner).mean() > 0.98
    assert abs(np.nanmedian(inner) - 7.3) < 0.04
    assert np.nanpercentile(np.abs(inner - 7.3), 90) < 0.06


def test_both_directions_are_mirror_images() -> None:
    rng = np.random.default_rng(3)
    wide = np.kron(rng.integers(0, 255, (40, 90)), np.ones((3, 3))).astype(np.uint8)
    left, right = wide[:, 5:245], wide[:, 11:251]  # x_left - x_right = 6
    assert np.nanmedian(sgbm(left, right, 0, 16)) == pytest.approx(6.0, abs=0.2)
    assert np.nanmedian(sgbm_right(left, right, 0, 16)) == pytest.approx(6.0, abs=0.2)


def test_filled_takes_the_farther_neighbour() -> None:
    row = np.array([[np.nan, 5.0, np.nan, np.nan, 3.0, np.nan]])
    np.testing.assert_array_equal(filled(row), [[5.0, 5.0, 3.0, 3.0, 3.0, 3.0]])


def test_what_does_not_fit_is_said(pair: tuple[list[Path], Path, rendered.View], tmp_path: Path) -> None:
    paths, calibration, _ = pair
    options = AcquisitionOptions(calibration=str(calibration))
    with pytest.raises(UsageError, match="left and right of each pair"):
        from_stereo([*paths, paths[0]], options)
    with pytest.raises(UsageError, match="--calibration"):
        from_stereo(paths, AcquisitionOptions())
    small = _save(tmp_path / "small.png", np.asarray(Image.open(paths[1]).resize((200, 150))))
    with pytest.raises(InputError, match="not of one rig"):
        from_stereo([paths[0], small], options)
    noise = _save(tmp_path / "noise.png", np.random.default_rng(0).integers(0, 255, (300, 400, 3), np.uint8))
    with pytest.raises(InputError, match="different things"):
        from_stereo([paths[0], noise], options)
    tree = json.loads(calibration.read_text())
    tree["K2"][1][2] += 12.0
    (tmp_path / "wrong.json").write_text(json.dumps(tree))
    with pytest.raises(InputError, match="the calibration is not of these pictures"):
        from_stereo(paths, AcquisitionOptions(calibration=str(tmp_path / "wrong.json")))
    (tmp_path / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe0 nothing")
    with pytest.raises(InputError, match=r"broken\.jpg cannot be read as a picture"):
        from_stereo([tmp_path / "broken.jpg", paths[1]], options)


def test_swapped_pictures_are_told() -> None:
    rng = np.random.default_rng(5)
    wide = np.kron(rng.integers(0, 255, (60, 120)), np.ones((4, 4))).astype(np.uint8)
    with pytest.raises(InputError, match="the other way around"):
        span(wide[:, 40:400], wide[:, 10:370], "a and b")


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.txt", "cam0=[1 0 1; 0 1 1; 0 0 1]\nbaseline=10\n", "lacks cam1"),
        ("a.txt", "cam0=[1 0 1; 0 1 1; 0 0 1]\ncam1=[1 0 1; 0 1 1; 0 0 1]\nbaseline=-3\n", "must be positive"),
        ("a.txt", "hello", "no calibration that is known"),
        ("a.json", "{}", "is no scan2fea stereo calibration"),
        ("a.json", "[", "is not JSON"),
        ("a.yml", "%YAML:1.0\n---\nx: 3\n", "a rig needs both cameras"),
    ],
)
def test_broken_calibrations_name_what_is_wrong(tmp_path: Path, name: str, text: str, says: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=says):
        read_rig(tmp_path / name, None)


def test_calibration_forms_give_the_same_rig(tmp_path: Path) -> None:
    text = "cam0=[700 0 320; 0 700 240; 0 0 1]\ncam1=[700 0 330; 0 700 240; 0 0 1]\ndoffs=10\nbaseline=120\nwidth=640\nheight=480\n"
    (tmp_path / "calib.txt").write_text(text)
    rig = read_rig(tmp_path / "calib.txt", None)
    assert rig.baseline_m == pytest.approx(0.12) and rig.size == (640, 480) and rig.unit_source == "format"
    (tmp_path / "rig.json").write_text(write_rig(rig))
    again = read_rig(tmp_path / "rig.json", None)
    np.testing.assert_array_equal(again.right.K, rig.right.K)
    np.testing.assert_array_equal(again.t, rig.t)
    matrix = "!!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [ {} ]\n"
    rows = {"M1": rig.left.K, "M2": rig.right.K, "R": np.eye(3), "T": np.array([[-120.0], [0.0], [0.0]])}
    body = "".join(f"{name}: " + matrix.format(*m.shape, ", ".join(str(float(x)) for x in m.ravel())) for name, m in rows.items())
    (tmp_path / "rig.yml").write_text("%YAML:1.0\n---\n" + body)
    opencv = read_rig(tmp_path / "rig.yml", 1e-3)
    np.testing.assert_allclose(opencv.t, rig.t)
    assert opencv.unit_source == "option" and read_rig(tmp_path / "rig.yml", None).unit_source == "assumed"


def test_one_camera_from_its_forms(tmp_path: Path) -> None:
    (tmp_path / "open3d.json").write_text(json.dumps({"intrinsic_matrix": K.T.ravel().tolist()}))
    (tmp_path / "own.json").write_text(json.dumps({"K": K.tolist()}))
    (tmp_path / "k.txt").write_text(" ".join(str(x) for x in K.ravel()))
    for name in ("open3d.json", "own.json", "k.txt"):
        np.testing.assert_array_equal(read_camera(tmp_path / name).K, K)
    (tmp_path / "k.txt").write_text("1 2 3")
    with pytest.raises(FormatError, match="9 numbers"):
        read_camera(tmp_path / "k.txt")


def test_board_text() -> None:
    board = board_of("9x6 25 mm")
    assert (board.columns, board.rows, board.side_m) == (9, 6, pytest.approx(0.025))
    for text in ("", "9x6", "9x6 25", "2x6 25 mm", "9x6 x mm"):
        with pytest.raises(UsageError, match="inner corners"):
            board_of(text)
    with pytest.raises(UsageError, match="unit"):
        board_of("9x6 25 parsec")


def test_chessboard_that_is_not_there(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="0 pairs of pictures named left"):
        calibrate(tmp_path, board_of("9x6 25 mm"))
    for side in ("left", "right"):
        for k in range(5):
            _save(tmp_path / f"{side}{k}.png", rng.integers(0, 255, (60, 80), np.uint8))
    with pytest.raises(InputError, match="9 x 6 inner corners was found in 0 of 5 pairs"):
        calibrate(tmp_path, board_of("9x6 25 mm"))


@real_scans.needs("photogrammetry")
def test_chessboards_of_a_real_rig() -> None:
    rig = calibrate(DATA / "stereo_calib", board_of("9x6 25 mm"))
    assert rig.rms_px < 0.5
    assert rig.baseline_m == pytest.approx(0.0834, abs=0.001)
    assert rig.left.K[0, 0] == pytest.approx(535.9, abs=5.0)  # left_intrinsics.yml of the same pictures


@real_scans.needs("photogrammetry")
def test_aloe_bad_pixels() -> None:
    left, right = (np.asarray(Image.open(DATA / "stereo_aloe" / f"aloe{side}.jpg").convert("L")) for side in "LR")
    truth = np.asarray(Image.open(DATA / "stereo_aloe" / "aloeGT.png"), float)
    least, most, rows, _ = span(left, right, "aloe")
    assert least < truth[truth > 0].min() and most > truth.max() - 2 and rows < 0.2
    found = disparity(left, right, least, most).px
    known = truth > 0
    bad = np.abs(found - truth) > 2.0
    assert bad[known & np.isfinite(found)].mean() < 0.03
    assert (np.abs(filled(found) - truth) > 2.0)[known].mean() < 0.09
