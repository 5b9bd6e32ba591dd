"""What is not known of the scanners' places, told of each object: how far the points of one frame may lie off those of another.

One frame's error moves all of its points together, so no number of points averages it away, and an object that one frame alone saw keeps its size.
Where several saw it, a distance between faces that different frames saw is uncertain by both.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.pipeline.dimension_doubt import FramePose, PoseDoubt
from scan2fea.pipeline.scene import Scene
from scan2fea.pipeline.sweeps import HOUR_S, SweepPath
from scan2fea.registration import pose_variance
from scan2fea.types import FloatArray, IntArray


def doubt_of(scene: Scene, rows: IntArray) -> PoseDoubt:
    """What is not known of the places from which the points of an object (rows of the scene's cloud) were measured.

    None where one still frame saw all of it or no pose has a deviation. `between_m` is of two points drawn at random: twice the mean variance,
    which is that of the pair where two frames share the object evenly.
    """
    cloud = scene.scan.cloud
    frame = cloud.frame[rows]
    rows, frame = rows[frame >= 0], frame[frame >= 0]
    paths = {path.frame: path for path in scene.paths}
    seen_by = np.unique(frame)
    if not len(rows) or (len(seen_by) == 1 and int(seen_by[0]) not in paths):
        return PoseDoubt()
    variance, of_moments, frames = np.zeros(len(rows)), np.zeros(len(rows)), []
    for k in seen_by.tolist():
        own = frame == k
        points = cloud.points[rows[own]]
        if len(seen_by) > 1:
            x, y, z = cloud.points[cloud.frame == k].mean(axis=0).tolist()
            pose = FramePose(frame=k, centre_m=(x, y, z), std_m=_known(scene.std_m, k), std_rad=_known(scene.std_rad, k))
            variance[own] = pose_variance(points - pose.centre_m, pose.std_m, pose.std_rad)
            frames += [pose] if pose.std_m > 0 or pose.std_rad > 0 else []
        if k in paths and scene.scan.rays is not None and scene.scan.rays.time_s is not None:
            ray = cloud.ray[rows[own]]
            if bool((ray >= 0).all()):
                of_moments[own] = _of_sweeps(paths[k], scene.scan.rays.time_s[ray], points - scene.scan.rays.origin[ray])
    between, moments = (math.sqrt(2.0 * float(v.mean())) for v in (variance + of_moments, of_moments))
    return PoseDoubt(frames=tuple(frames), between_m=between, moments_m=moments)


def smeared_by(scene: Scene, frame: IntArray) -> str:
    """Why a scanner's motion is in points of these frames, "" where it is in none."""
    return next((scene.smeared[k] for k in np.unique(frame).tolist() if 0 <= k < len(scene.smeared) and scene.smeared[k]), "")


def _known(std: FloatArray, k: int) -> float:
    return float(std[k]) if k < len(std) and math.isfinite(std[k]) else 0.0


def _of_sweeps(path: SweepPath, time_s: FloatArray, arm: FloatArray) -> FloatArray:
    """(n,) variance along one axis of points seen at (n,) moments from arm (n, 3) away."""
    std_m, std_rad = np.nan_to_num(path.std_m), np.nan_to_num(path.std_rad)
    time = time_s + HOUR_S * np.round((float(path.time_s[0]) - float(np.median(time_s))) / HOUR_S)
    return pose_variance(arm, np.interp(time, path.time_s, std_m), np.interp(time, path.time_s, std_rad))
