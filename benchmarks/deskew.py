"""Motion within a sweep taken out of two real sweeps (registration/newer_06_deskew: raw points, their moments, the same points deskewed by an IMU).

    SCAN2FEA_DATA=DATA python benchmarks/deskew.py

Three figures for each sweep, against the cloud deskewed by the IMU (its frame is turned by half a turn: the mounting is fitted at the first
moments): as it lies; by an even motion between the ends that the IMU's cloud tells (what the model of even motion can do); and by the even motion
that point to plane against the other sweep's deskewed cloud finds, begun from a registration without initial guess. Nothing is asserted.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.trajectories import between
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration import RegistrationOptions, deskewed, place
from scan2fea.registration.icp import robust_scale, tukey
from scan2fea.registration.motion import stepped
from scan2fea.registration.ransac import kabsch
from scan2fea.types import FloatArray, PointCloud, Scan

EDGE_M, NEIGHBOURS = 0.4, 12
ROUNDS, REACH_M, CLOSING, LEAST_REACH_M = 60, 2.5, 0.93, 0.4
NOISE_M = 0.02
ENDS_S = 0.003  # of the first and the last moments, by which the ends of the reference motion are told


def clouds(name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Raw points, share of the sweep at each, deskewed points."""
    at = Path(os.environ["SCAN2FEA_DATA"]) / "registration" / "newer_06_deskew"
    raw, told = (np.fromfile(at / f"{kind}_{name}.bin", "<f4").reshape(-1, 3).astype(float) for kind in ("raw", "deskewed"))
    moment = np.fromfile(at / f"times_{name}.bin", "<f4").astype(float)
    return raw, moment / moment.max(), told


def ends(raw: FloatArray, share: FloatArray, told: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mounting (4, 4), and the motion within the sweep that the deskewed cloud tells."""
    first, last = share < ENDS_S / 0.1, share > 1 - ENDS_S / 0.1
    T = [np.asarray(kabsch(raw[rows][None], told[rows][None])[0]) for rows in (first, last)]
    return T[0], inverse(T[0]) @ T[1]


def motion_against(raw: FloatArray, share: FloatArray, other: FloatArray) -> FloatArray:
    """The even motion within a sweep, both ends free, by point to plane against another cloud."""
    scans = [Scan(cloud=PointCloud.of(points)) for points in (other, raw)]
    T = place(scans, [None, None], ["other", "this"], RegistrationOptions(mode="free")).trajectory.T_world_frame
    knots = np.array([inverse(T[0]) @ T[1]] * 2)
    cells = voxel_mean(other, EDGE_M).mean
    normal, tree = pca_normals(cells, NEIGHBOURS), cKDTree(cells)
    points, at = raw[::2], share[::2]
    for k in range(ROUNDS):
        R, x = between(knots, np.zeros(len(points), np.int64), at)
        arm = np.einsum("nij,nj->ni", R, points)
        far, near = tree.query(arm + x, distance_upper_bound=max(REACH_M * CLOSING**k, LEAST_REACH_M))
        on = np.flatnonzero(np.isfinite(far))
        n = normal[near[on]]
        across = np.einsum("nc,nc->n", arm[on] + x[on] - cells[near[on]], n)
        scale = max(robust_scale(across), NOISE_M)
        weight = tukey(across, scale)
        own, s = np.concatenate([np.cross(arm[on], n), n], axis=1), at[on][:, None]
        J = np.concatenate([own * (1 - s), own * s], axis=1)
        H = J.T @ (J * weight[:, None])
        knots = stepped(knots, -np.linalg.solve(H + 1e-9 * np.trace(H) * np.eye(12), J.T @ (weight * across)).reshape(2, 6))
    motion: FloatArray = inverse(knots[0]) @ knots[1]
    return motion


def main() -> None:
    sweeps = {name: clouds(name) for name in ("00", "01")}
    for name, other in (("00", "01"), ("01", "00")):
        raw, share, told = sweeps[name]
        mounting, motion = ends(raw, share, told)
        started = time.process_time()
        found = motion_against(raw, share, sweeps[other][2])
        cpu = time.process_time() - started
        for what, T in (("as it lies", np.eye(4)), ("even, ends known", motion), ("even, searched", found)):
            off = np.linalg.norm(applied(mounting, deskewed(raw, share, T)) - told, axis=1)
            print(f"{name} {what}: rms {np.sqrt((off**2).mean()):.3f} m, median {np.median(off):.3f} m, 95 % within {np.quantile(off, 0.95):.3f} m")
        print(f"   {cpu:.1f} cpu s")


if __name__ == "__main__":
    main()
