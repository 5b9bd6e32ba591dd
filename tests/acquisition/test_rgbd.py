"""Depth images: closed forms, layouts of folders, messages; the Open3D frames of SCAN2FEA_DATA."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import real_scans
from scan2fea.acquisition import AcquisitionOptions, from_rgbd, is_rgbd
from scan2fea.errors import InputError

DATA = real_scans.DATA / "registration" / "open3d_rgbd"
K = np.array([[100.0, 0.0, 49.5], [0.0, 110.0, 39.5], [0.0, 0.0, 1.0]])


def _folder(path: Path, depth_mm: np.ndarray, *, inner: bool, intrinsics: bool = True) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    depth, colour = (path / "depth" / "7.png", path / "color" / "7.png") if inner else (path / "depth_7.png", path / "color_7.png")
    for place in (depth, colour):
        place.parent.mkdir(exist_ok=True)
    Image.fromarray(depth_mm.astype(np.uint16)).save(depth)
    Image.fromarray(np.full((*depth_mm.shape, 3), (10, 20, 30), np.uint8)).save(colour)
    if intrinsics:
        (path / "intrinsic.json").write_text(json.dumps({"K": K.tolist()}))
    return path


@pytest.mark.parametrize("inner", [True, False])
def test_a_plane_square_to_the_view(tmp_path: Path, inner: bool) -> None:
    made = from_rgbd(_folder(tmp_path, np.full((80, 100), 2000), inner=inner), AcquisitionOptions())
    cloud = made.frames[0].scan.cloud
    assert len(cloud) == 8000
    np.testing.assert_allclose(cloud.points[:, 2], 2.0)
    np.testing.assert_allclose(cloud.points[0], [-0.99, -2.0 * 39.5 / 110.0, 2.0])
    np.testing.assert_array_equal(cloud.colour[0], [10, 20, 30])
    np.testing.assert_array_equal(made.frames[0].scan.sensors(), 0.0)
    middle = np.argmin(np.linalg.norm(cloud.points[:, :2], axis=1))
    assert cloud.sigma_along_m[middle] == pytest.approx(0.0012 + 0.0019 * 1.6**2, rel=1e-3)  # Nguyen 2012 at 2 m
    np.testing.assert_allclose(cloud.sigma_across_m, 0.8 * 2.0 / 100.0)


def test_missing_far_and_torn_depths_are_left_out(tmp_path: Path) -> None:
    depth = np.full((80, 100), 2000)
    depth[:, 50:] = 3000  # a step: the columns beside it are neither
    depth[0, :] = 0
    depth[1, :] = 9000
    made = from_rgbd(_folder(tmp_path, depth, inner=True), AcquisitionOptions())
    z = made.frames[0].scan.cloud.points[:, 2]
    assert set(np.unique(z)) == {2.0, 3.0}
    assert len(z) == 77 * 98  # row 2 lies beside the step of row 1


def test_depth_scale(tmp_path: Path) -> None:
    folder = _folder(tmp_path, np.full((80, 100), 5000), inner=True)
    z = from_rgbd(folder, AcquisitionOptions(depth_per_m=5000.0)).frames[0].scan.cloud.points[:, 2]
    np.testing.assert_allclose(z, 1.0)


def test_what_is_wrong_is_said(tmp_path: Path) -> None:
    assert not is_rgbd(tmp_path)
    folder = _folder(tmp_path / "a", np.full((80, 100), 2000), inner=False, intrinsics=False)
    with pytest.raises(InputError, match="100 x 80 pixels are not known: give them with --calibration"):
        from_rgbd(folder, AcquisitionOptions())
    far = _folder(tmp_path / "b", np.full((80, 100), 60000), inner=False)
    with pytest.raises(InputError, match="depth_per_m"):
        from_rgbd(far, AcquisitionOptions())
    Image.fromarray(np.zeros((80, 100), np.uint8)).save(far / "depth_7.png")
    with pytest.raises(InputError, match="16 bits"):
        from_rgbd(far, AcquisitionOptions())


@real_scans.needs("registration", "open3d_rgbd")
def test_real_frames_of_a_depth_camera() -> None:
    made = from_rgbd(DATA, AcquisitionOptions())
    assert len(made.frames) == 5 and all(len(frame.scan.cloud) > 100_000 for frame in made.frames)
    assert all(frame.T_world_frame is None and frame.scan.cloud.colour is not None for frame in made.frames)
    assert "PrimeSense" in made.notes[0]
