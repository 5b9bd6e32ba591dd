"""What stands in the way and what is put behind it: figures on a simulated room, and range images before and after as a picture.

python benchmarks/occlusion.py [FILE.pcd.bin ...] [-o FOLDER]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from occluded import ROOM, rings, seen
from scan2fea.filtering.disocclusion import METHODS, disocclude
from scan2fea.filtering.range_image import RangeImage, range_image, range_noise
from scan2fea.io import read_scan
from scan2fea.io.kitti import as_float

ORANGE, ROW_PIXELS, WIDEST = (230, 120, 20), 6, 1080


def room() -> None:
    print("cells           sigma  method       IoU    filled  off the walls, rms  CPU s")
    for columns, elevations in ((1080, None), (2160, None), (1440, np.arange(-40, 40, 0.25))):
        direction, ring = rings(columns, elevations)
        for sigma in (0.0, 0.02):
            points, truth, _ = seen(direction, sigma)
            image = range_image(points, np.zeros(3), ring)
            for method in METHODS:
                begun = time.process_time()
                found = disocclude(image, range_noise(image), method)
                cpu = time.process_time() - begun
                iou = (found.is_occluder & truth).sum() / (found.is_occluder | truth).sum()
                off = np.min([np.abs(found.points - ROOM[0]).min(axis=1), np.abs(found.points - ROOM[1]).min(axis=1)], axis=0)
                rms = float(np.sqrt((off**2).mean()))
                print(f"{image.range_m.shape!s:<15} {sigma:<6} {method:<12} {iou:.3f}  {len(off):<7} {1000 * rms:8.1f} mm         {cpu:.2f}")


def picture(image: RangeImage, folder: Path, name: str) -> None:
    found = disocclude(image, range_noise(image))
    mask = np.zeros(image.range_m.shape, bool)
    mask.ravel()[image.cell[found.is_occluder]] = True
    after = np.where(np.isfinite(found.filled_m), found.filled_m, image.range_m)
    low, high = np.log(np.nanquantile(image.range_m, [0.01, 0.99]))

    def grey(r: np.ndarray) -> np.ndarray:
        shade = 255 - 215 * np.clip((np.log(r) - low) / (high - low), 0, 1)
        return np.repeat(np.nan_to_num(shade, nan=0)[..., None], 3, axis=2).astype(np.uint8)

    marked = grey(image.range_m)
    marked[mask] = ORANGE
    step = max(1, image.range_m.shape[1] // WIDEST)
    tall = max(1, ROW_PIXELS * 32 // image.range_m.shape[0])
    parts = [np.repeat(part[::-1, ::-step], tall, axis=0) for part in (grey(image.range_m), marked, grey(after))]
    gap = np.full((4, parts[0].shape[1], 3), 255, np.uint8)
    path = folder / f"occlusion_{name}.png"
    Image.fromarray(np.concatenate([parts[0], gap, parts[1], gap, parts[2]])).quantize(64).save(path, optimize=True)
    print(f"{path} ({path.stat().st_size} bytes): {mask.sum()} cells stand in the way, {len(found.points)} points put behind them")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="sweeps seen from their origin")
    parser.add_argument("-o", "--out", type=Path, default=Path("."))
    given = parser.parse_args()
    room()
    direction, ring = rings(1080)
    picture(range_image(seen(direction)[0], np.zeros(3), ring), given.out, "room")
    for path in given.files:
        scan = read_scan(path).scan
        far = np.linalg.norm(scan.cloud.points, axis=1) > 2.5  # the carrier itself
        own = None if scan.rays is None or scan.rays.ring is None else scan.rays.ring[scan.cloud.ray][far]
        picture(range_image(as_float(scan.cloud.points[far]), np.zeros(3), own), given.out, path.name.split(".")[0][:8])


if __name__ == "__main__":
    main()
