"""Section 4.3 as the thesis has it: LiDAR sweeps joined without poses, from the capture alone, beside the poses that are known."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import InputError
from scan2fea.io import read_scan
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.pipeline.sweeps import SweepPath, unrolled, unwrapped
from scan2fea.registration import RegistrationOptions
from scan2fea.report.colours import viridis
from scan2fea.simulation.motion import SensorPath, path_of, trajectory_at
from scan2fea.thesis.bench import Bench, ThesisOptions
from scan2fea.thesis.canvas import tiles
from scan2fea.thesis.clouds import HDL, capture, hdl_scans, hdl_sensor
from scan2fea.thesis.experiment import Cell, Chore, Made, Table
from scan2fea.thesis.pictures import cloud_picture
from scan2fea.types import FloatArray, Scan, Value

_WIDE, _DRAWN = 460, 40_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Way(Value):
    """One capture whose motion was searched.

    n_sweeps, n_points : of it.   says : what the program says of the motion; found : whether it believes it.   place_m, turn_deg : worst error of a
    pose, relative to the second (before the first and after the last sweep nothing was measured).   stated_m : the largest standard deviation stated.
    cloud_m : rms distance of the points from where the true poses have them; all four nan where no motion was found.
    lying, joined, true : (m, 3) some of the points as they lie, with the poses found and with the true ones; nan where none were found.
    """

    n_sweeps: int
    n_points: int
    found: bool
    says: str
    place_m: float
    turn_deg: float
    stated_m: float
    cloud_m: float
    lying: FloatArray
    joined: FloatArray
    true: FloatArray


def shares(options: ThesisOptions) -> tuple[int, ...]:
    """One sweep in so many is kept; all of them take a minute and a half and are left to the full run."""
    return (5,) if options.quick else (5, 1)


def chores(options: ThesisOptions) -> list[Chore]:
    every = [str(k) for k in shares(options)]
    return [*(("hdl", k) for k in every), *(("unposed", k) for k in every)]


def way(bench: Bench, every: int) -> Way:
    """The sweeps, one in `every`, written as a capture, read back, and put together by what they themselves tell."""
    return bench.kept("unposed", lambda: _way(bench, every), every)


def _way(bench: Bench, every: int) -> Way:
    options = hdl_sensor(bench, every).sensors[0].options
    scans = hdl_scans(bench, every)
    with tempfile.TemporaryDirectory() as folder:
        raw = read_scan(capture(bench, every, Path(folder)))
    made, found, why = unrolled(raw, 0, RegistrationOptions(sweeps="odometry"), None)
    points = np.asarray(raw.scan.cloud.points)
    drawn = sampled_rows(len(points), _DRAWN, 0)
    off, stated, joined, true = (np.full((1, 4, 4), np.nan), math.nan, *(np.full_like(points, np.nan) for _ in range(2)))
    if found is not None:
        off, true = _compared(raw.scan, found, path_of(options, HDL))
        stated, joined = float(np.nanmax(found.std_m)), applied(inverse(found.T_frame_scanner[0]), np.asarray(made.scan.cloud.points))
    return Way(
        n_sweeps=len(scans), n_points=len(points), found=found is not None, says=why or made.notes[-1], stated_m=stated,
        place_m=float(np.linalg.norm(off[:, :3, 3], axis=1).max()), turn_deg=float(turned_deg(off).max()),
        cloud_m=float(np.sqrt(np.mean(np.sum((joined - true) ** 2, axis=1)))),
        lying=points[drawn], joined=joined[drawn], true=true[drawn],
    )  # fmt: skip


def turned_deg(T: FloatArray) -> FloatArray:
    """(k,) angle of each motion (k, 4, 4), degrees: |R - 1| = sqrt(8) sin(angle / 2)."""
    gap = np.linalg.norm(T[:, :3, :3] - np.eye(3), axis=(1, 2))
    return np.asarray(np.degrees(2 * np.arcsin(np.clip(gap / math.sqrt(8), 0, 1))))


def _compared(scan: Scan, found: SweepPath, path: SensorPath) -> tuple[FloatArray, FloatArray]:
    """(k, 4, 4) what each pose found is off by, and (n, 3) where the points truly are; both relative to the first pose."""
    if scan.rays is None or scan.rays.time_s is None:
        raise InputError("the simulated capture holds no times")
    here = trajectory_at(path, unwrapped(scan.rays.time_s[scan.cloud.ray])).T_world_frame
    truly, own = trajectory_at(path, found.time_s).T_world_frame, found.T_frame_scanner
    off = np.linalg.inv(inverse(truly[0]) @ truly) @ inverse(own[0]) @ own
    true = np.einsum("nij,nj->ni", here[:, :3, :3], scan.cloud.points) + here[:, :3, 3]
    return off, applied(inverse(truly[0]), true)


def without_poses(bench: Bench) -> Made:
    """Section 4.3: the sweeps as they lie, joined by what they tell, and with the poses known."""
    rows: list[tuple[Cell, ...]] = []
    says: list[str] = []
    for every in shares(bench.options):
        w = way(bench, every)
        name = "every sweep" if every == 1 else f"one sweep in {every}"
        told = (1e3 * w.place_m, w.turn_deg, 1e3 * w.stated_m, 1e3 * w.cloud_m) if w.found else (None,) * 4
        rows.append((name, w.n_sweeps, w.n_points, w.found, *told))
        says.append(f"{name}: {w.says}.")
    first = way(bench, shares(bench.options)[0])
    shown = {"as the capture has them": first.lying}
    if first.found:
        shown |= {"joined without poses": first.joined, "joined with the true poses": first.true}
    pictures = [(title, cloud_picture(p, _by_height(p), width=_WIDE)) for title, p in shown.items()]
    says.append(
        "The thesis joins its frames without poses and tells no error. Here a capture is written, read as any file is "
        "(registration.sweeps = odometry), and compared with the path that was simulated. The beam of such a capture stands in section 4.4 beside "
        "those of known poses, which the meshes of 4.3 are made of."
    )
    head = ("sweeps kept", "sweeps", "points", "motion found", "worst place, mm", "worst turn, degrees", "stated, mm", "rms of the points, mm")
    return Made(picture=tiles(pictures, 3), table=Table(head=head, rows=tuple(rows)), says=tuple(says))


def _by_height(points: FloatArray) -> np.ndarray:
    low, high = np.percentile(points[:, 2], [2, 98])
    return viridis((points[:, 2] - low) / max(high - low, 1e-9))
