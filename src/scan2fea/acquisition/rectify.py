"""Two pictures turned so that the same row of both shows the same plane through both cameras (Fusiello, Trucco, Verri 2000)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.acquisition.cameras import Camera
from scan2fea.types import BoolArray, ByteArray, FloatArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Rectified(Value):
    """R_rect_left, R_rect_right : (3, 3) from each camera's axes to the common ones.   K_left, K_right : (3, 3), same focal length and row of the
    principal point; columns differ by what keeps disparities small.   size : (width, height).   is_same : the pictures were rectified already.
    """

    R_rect_left: FloatArray
    R_rect_right: FloatArray
    K_left: FloatArray
    K_right: FloatArray
    size: tuple[int, int]
    baseline_m: float
    is_same: bool

    @property
    def offset_px(self) -> float:
        """Disparity of a point infinitely far away."""
        return float(self.K_left[0, 2] - self.K_right[0, 2])

    def depth_m(self, disparity: FloatArray) -> FloatArray:
        """Along the common viewing axis."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.K_left[0, 0] * self.baseline_m / (disparity - self.offset_px))


def rectified(left: Camera, right: Camera, R: FloatArray, t: FloatArray, size: tuple[int, int]) -> Rectified:
    """Common axes of two cameras, x_right = R x_left + t; t must point to the left (the right camera's centre lies to the right).

    The new x axis is the baseline, the new viewing axis the mean of both, as far as it is square to the baseline.
    """
    baseline = float(np.linalg.norm(t))
    if _is_rectified(left, right, R, t):
        return Rectified(
            R_rect_left=np.eye(3), R_rect_right=np.eye(3), K_left=left.K, K_right=right.K, size=size, baseline_m=baseline, is_same=True
        )  # fmt: skip
    x = -R.T @ t / baseline  # the right camera's centre in the left one's axes
    mean = np.array([0.0, 0.0, 1.0]) + R.T[:, 2]
    z = mean - (mean @ x) * x
    z /= np.linalg.norm(z)
    axes = np.stack([x, np.cross(z, x), z])
    turn = (axes, axes @ R.T)
    focal = float(np.mean([left.K[1, 1], right.K[1, 1]]))
    # of each camera what its picture shows is brought to the middle; rows together, columns each on its own: that only shifts all disparities
    middle = [_middle(camera, own, focal, size) for camera, own in zip((left, right), turn, strict=True)]
    row = (size[1] - 1) / 2 - float(np.mean([m[1] for m in middle]))
    K = [np.array([[focal, 0.0, (size[0] - 1) / 2 - m[0]], [0.0, focal, row], [0.0, 0.0, 1.0]]) for m in middle]
    return Rectified(R_rect_left=turn[0], R_rect_right=turn[1], K_left=K[0], K_right=K[1], size=size, baseline_m=baseline, is_same=False)


def _is_rectified(left: Camera, right: Camera, R: FloatArray, t: FloatArray) -> bool:
    aligned = np.array_equal(R, np.eye(3)) and t[1] == 0 and t[2] == 0 and t[0] < 0
    same = bool(np.array_equal(left.K[:2, :2], right.K[:2, :2])) and left.K[1, 2] == right.K[1, 2] and left.K[0, 0] == left.K[1, 1]
    return bool(aligned and same and not left.distortion.any() and not right.distortion.any())


def _middle(camera: Camera, R: FloatArray, focal: float, size: tuple[int, int]) -> FloatArray:
    """(2,) where the middle of the picture comes to lie, pixels from the principal point."""
    import cv2

    corners = np.array([[0.0, 0.0], [size[0] - 1.0, 0.0], [0.0, size[1] - 1.0], [size[0] - 1.0, size[1] - 1.0]]).reshape(-1, 1, 2)
    seen = np.asarray(cv2.undistortPoints(corners, camera.K, camera.distortion, R=R, P=np.diag([focal, focal, 1.0])), float)
    return np.asarray(seen.reshape(-1, 2).mean(axis=0))


def warped(picture: ByteArray, camera: Camera, R: FloatArray, K: FloatArray, size: tuple[int, int]) -> ByteArray:
    """The picture as the turned camera would show it."""
    import cv2

    maps = cv2.initUndistortRectifyMap(camera.K, camera.distortion, R, K, size, cv2.CV_32FC1)
    return np.asarray(cv2.remap(picture, maps[0], maps[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT), np.uint8)


def seen_by(camera: Camera, R: FloatArray, K: FloatArray, size: tuple[int, int], picture: tuple[int, int]) -> BoolArray:
    """(h, w) bool: pixels of the turned picture that lie in the taken one, of `picture` (width, height)."""
    import cv2

    maps = cv2.initUndistortRectifyMap(camera.K, camera.distortion, R, K, size, cv2.CV_32FC1)
    return np.asarray((maps[0] >= 0) & (maps[0] <= picture[0] - 1) & (maps[1] >= 0) & (maps[1] <= picture[1] - 1))
