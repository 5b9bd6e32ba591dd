"""Stereo, chessboards and photographs against their truth: python benchmarks/acquisition.py [stereo|chess|fountain|FOLDER]. Needs SCAN2FEA_DATA.

Times are processor seconds of the process.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image

from scan2fea.acquisition import Acquired, AcquisitionOptions, from_photographs
from scan2fea.acquisition.chessboard import board_of, calibrate
from scan2fea.acquisition.disparity import disparity, filled
from scan2fea.acquisition.stereo import span
from scan2fea.kernel.transforms import applied
from scan2fea.types import FloatArray

DATA = Path(os.environ.get("SCAN2FEA_DATA", "../shared/data")) / "photogrammetry"


def stereo() -> None:
    """Aloe: share of pixels with a true disparity that are off by more than 2 px, beside OpenCV's plain matcher with the settings of its sample."""
    import cv2

    left, right = (np.asarray(Image.open(DATA / "stereo_aloe" / f"aloe{side}.jpg").convert("L")) for side in "LR")
    truth = np.asarray(Image.open(DATA / "stereo_aloe" / "aloeGT.png"), float)
    started = time.process_time()
    least, most, rows, n = span(left, right, "aloe")
    found = disparity(left, right, least, most).px
    seconds = time.process_time() - started
    print(f"aloe: range {least:.0f} .. {most:.0f} px from the pictures, rows differ by {rows:.2f} px ({n} features), {seconds:.1f} s")
    plain = cv2.StereoSGBM.create(
        minDisparity=16, numDisparities=208, blockSize=5, P1=200, P2=800, disp12MaxDiff=1, uniquenessRatio=10, speckleWindowSize=100, speckleRange=32
    )
    theirs = plain.compute(left, right).astype(float) / 16
    theirs[theirs < 16] = np.nan
    known = truth > 0
    rows_of = {"ours, kept": found, "ours, filled": filled(found), "plain SGBM, kept": theirs, "plain SGBM, filled": filled(theirs)}
    for name, d in rows_of.items():
        bad, have = np.abs(d - truth) > 2.0, known & np.isfinite(d)
        missed = 1 - (have & ~bad).sum() / known.sum()
        print(f"  {name:20} known {have.sum() / known.sum():6.1%}  bad-2.0 of these {bad[have].mean():6.2%}  of all {missed:6.2%}")


def chess() -> None:
    """Reprojection error of the chessboards."""
    started = time.process_time()
    rig = calibrate(DATA / "stereo_calib", board_of("9x6 25 mm"))
    seconds = time.process_time() - started
    print(f"chessboards: rms {rig.rms_px:.3f} px, baseline {rig.baseline_m * 1e3:.2f} mm, {seconds:.1f} s; {'; '.join(rig.notes)}")


def photographs(folder: Path) -> Acquired:
    """Structure and depths of a folder, with its figures."""
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".jpg", ".png"))
    started, wall = time.process_time(), time.perf_counter()
    made = from_photographs(paths, AcquisitionOptions())
    print(f"{folder.name}: {time.process_time() - started:.0f} s of processor, {time.perf_counter() - wall:.0f} s by the clock")
    print(json.dumps(made.how, indent=1, default=str))
    for note in made.notes:
        print("  note:", note)
    return made


def fountain() -> None:
    """Camera centres after a similarity, and the noise of the wall."""
    folder = DATA / "fountain-P11"
    made = photographs(folder)
    truth = json.loads((folder / "cameras_gt.json").read_text())
    frames = [frame for frame in made.frames if frame.T_world_frame is not None]
    found = np.array([frame.T_world_frame[:3, 3] for frame in frames])
    true = np.array([truth[Path(frame.name).name]["center_world"] for frame in frames])
    R, t, s = similarity(found, true)
    off = np.linalg.norm(s * found @ R.T + t - true, axis=1)
    extent = max(float(np.linalg.norm(a - b)) for a in true for b in true)
    middle, worst = float(np.median(off)), float(off.max())
    print(f"camera centres: median {1e3 * middle:.1f} mm = {middle / extent:.3%}, worst {1e3 * worst:.1f} mm = {worst / extent:.3%}")
    points = np.concatenate([s * applied(frame.T_world_frame, frame.scan.cloud.points) @ R.T + t for frame in frames])
    _, residual, share = largest_plane(points)
    print(f"wall: {share:.0%} of {len(points)} points within 50 mm of one plane, rms {1e3 * residual:.1f} mm")


def similarity(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Rotation, shift and scale with b = s R a + t in least squares (Umeyama 1991)."""
    ca, cb = a - a.mean(axis=0), b - b.mean(axis=0)
    U, S, Vt = np.linalg.svd(cb.T @ ca)
    D = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    s = float((S * np.diag(D)).sum() / (ca**2).sum())
    R = U @ D @ Vt
    return R, b.mean(axis=0) - s * R @ a.mean(axis=0), s


def largest_plane(points: FloatArray) -> tuple[FloatArray, float, float]:
    """Normal, rms of the points within 50 mm, and their share, of the plane that most points lie on (500 draws)."""
    rng = np.random.default_rng(0)
    few = points[rng.choice(len(points), min(20_000, len(points)), replace=False)]
    best = (np.zeros(3), 0.0, np.zeros(len(few), bool))
    for _ in range(500):
        p = few[rng.choice(len(few), 3, replace=False)]
        n = np.cross(p[1] - p[0], p[2] - p[0])
        if np.linalg.norm(n) > 0:
            n = n / np.linalg.norm(n)
            near = np.abs((few - p[0]) @ n) < 0.05
            if near.sum() > best[2].sum():
                best = (n, 0.0, near)
    own = few[best[2]]
    _, _, V = np.linalg.svd(own - own.mean(axis=0), full_matrices=False)
    return V[2], float(np.sqrt((((own - own.mean(axis=0)) @ V[2]) ** 2).mean())), float(best[2].mean())


if __name__ == "__main__":
    for wanted in sys.argv[1:] or ["stereo", "chess", "fountain"]:
        if Path(wanted).is_dir():
            photographs(Path(wanted))
        else:
            {"stereo": stereo, "chess": chess, "fountain": fountain}[wanted]()
