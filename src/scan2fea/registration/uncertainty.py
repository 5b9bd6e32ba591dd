"""What is not known of a frame's place, told of each of its points."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.noise import noise_sigma, sampled_rows
from scan2fea.types import FloatArray, PointCloud

_SAMPLE = 60_000  # points that the noise is told from where the file does not state it


def with_pose_noise(cloud: PointCloud, std_m: float, std_rad: float) -> PointCloud:
    """The points of one frame with the uncertainty of its pose in `sigma_along_m` and `sigma_across_m`.

    std_m, std_rad : of the frame's centre and turn, of all three axes together. A turn moves a point r off the centre by 2/9 (std_rad r)^2 in
    variance along any one axis (two thirds of it over three). Noise that the file does not state is told from the points, along the ray. Unchanged
    where the pose has no deviation.
    """
    if not (math.isfinite(std_m) and math.isfinite(std_rad)) or (std_m == 0 and std_rad == 0) or not len(cloud):
        return cloud
    pose2 = pose_variance(cloud.points - cloud.points.mean(axis=0), std_m, std_rad)
    along = cloud.sigma_along_m
    if along is None or not np.isfinite(along).any():
        told = noise_sigma(cloud.points[sampled_rows(len(cloud), _SAMPLE, 0)])
        along = np.full(len(cloud), told)
    across = np.zeros(len(cloud)) if cloud.sigma_across_m is None else cloud.sigma_across_m
    return cloud.replaced(sigma_along_m=_joined(along, pose2), sigma_across_m=_joined(across, pose2))


def pose_variance(arm: FloatArray, std_m: float | FloatArray, std_rad: float | FloatArray) -> FloatArray:
    """(n,) variance (m2) along any one axis of points arm (n, 3) from what turns; std_m, std_rad : of place and turn, all three axes together."""
    return np.asarray(np.square(std_m) / 3.0 + 2.0 / 9.0 * np.square(std_rad) * (arm**2).sum(axis=1))


def _joined(own: FloatArray, pose2: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(own**2 + pose2))
