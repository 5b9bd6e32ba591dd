"""A real HDL-32E beside the simulated one: elevations of the rings and steps of the azimuth, printed, and drawn as an HTML page.

    python benchmarks/lidar_histograms.py [CAPTURE.pcap] [-o FILE.html]

The capture is monterey-first-100-packets.pcap in the folder velodyne of SCAN2FEA_DATA unless another is given. The simulated unit turns at
the rate of the real one; both captures are decoded by the same reader.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np

from scan2fea.io.files import write_text
from scan2fea.io.velodyne import open_velodyne, write_velodyne
from scan2fea.kernel.lidar_units import HDL32E
from scan2fea.report.charts import histogram
from scan2fea.simulation.lab17 import lab17
from scan2fea.simulation.lidar import Hdl32eOptions, firings_of, scan_lidar

DATA = Path(os.environ.get("SCAN2FEA_DATA", Path(__file__).parents[2] / "shared/data"))


def told(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Elevation of every shot (degrees, from its direction), and the steps of the azimuth between firings (0.01 degree)."""
    pieces = list(open_velodyne(path, path.stat().st_size).pieces(frozenset()))
    direction = np.concatenate([piece.direction for piece in pieces])
    seen = ~np.concatenate([piece.is_miss for piece in pieces])
    head = direction[:: len(HDL32E.elevations_deg)]
    azimuth = np.rint(np.degrees(np.arctan2(-head[:, 1], head[:, 0])) * 100).astype(int)
    return np.degrees(np.arcsin(direction[seen, 2])), np.diff(azimuth) % 36000


def simulated(rate_hz: float, turns: int, path: Path) -> None:
    """A capture of the lab at a rate of turn."""
    options = Hdl32eOptions(positions_m=((0.5, 0.6, 1.2),), rate_hz=rate_hz, frames=turns)
    firings = [firings_of(scan, options) for scan in scan_lidar(lab17(), options, 1)]
    write_velodyne(path, *(np.concatenate([getattr(f, name) for f in firings]) for name in ("time_s", "azimuth_deg", "range_m", "intensity")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("capture", nargs="?", type=Path, default=DATA / "velodyne" / "monterey-first-100-packets.pcap")
    parser.add_argument("-o", type=Path, help="where to draw the histograms")
    given = parser.parse_args()
    if not given.capture.is_file():
        print(f"{given.capture} is not here: set SCAN2FEA_DATA, or name a capture")
        return
    real = told(given.capture)
    rate = real[1].mean() / 36000 / (HDL32E.firing_us * 1e-6)
    with tempfile.TemporaryDirectory() as folder:
        simulated(rate, 18, Path(folder) / "simulated.pcap")
        ours = told(Path(folder) / "simulated.pcap")
    print(f"rate of turn {rate:.3f} Hz; azimuth step (0.01 deg): real {real[1].mean():.3f} sd {real[1].std():.3f}, ", end="")
    print(f"simulated {ours[1].mean():.3f} sd {ours[1].std():.3f}")
    bins = np.arange(int(real[1].min()), int(real[1].max()) + 2)
    for step, a, b in zip(bins, *(np.histogram(steps, bins)[0] / len(steps) for steps in (real[1], ours[1])), strict=False):
        print(f"  step {step}: real {a:.4f}, simulated {b:.4f}")
    print("elevations with returns (deg): real", np.unique(np.round(real[0], 2)).tolist())
    print("                          simulated", np.unique(np.round(ours[0], 2)).tolist())
    if given.o:
        charts = []
        for name, (elevation, step) in (("real", real), ("simulated", ours)):
            charts.append(histogram(elevation, low=-32.0, high=12.0, axis="elevation, deg", title=f"Rings, {name}", n_bins=132))
            charts.append(histogram(step.astype(float), low=14.5, high=25.5, axis="step, 0.01 deg", title=f"Azimuth steps, {name}", n_bins=11))
        write_text(given.o, "<!doctype html><meta charset='utf-8'>" + "".join(str(chart) for chart in charts))


if __name__ == "__main__":
    main()
