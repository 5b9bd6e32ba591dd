"""Clouds of real objects through `scan2fea reconstruct`, and a picture of what each leaves: python benchmarks/real_clouds.py [FILE ...] -o PICTURE.

The files default to those of the data folder (SCAN2FEA_DATA). A surface that passed is drawn grey, the open sheet of one that was refused in the
colour of what is invented.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

from scan2fea.cli.main import main as command
from scan2fea.io import read_mesh
from scan2fea.report.camera import look_at
from scan2fea.report.colours import ORIGIN_COLOURS
from scan2fea.report.render import Shape, render
from scan2fea.types import INVENTED

FILES = ("kitten.xyz", "ball.ply", "oni.pwn", "hippo1.ply")
PIXELS = 300


def pictured(file: Path) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        begin = time.process_time()
        code = command(["reconstruct", str(file), "-o", folder])
        print(f"exit {code}, {time.process_time() - begin:.1f} s of processor time\n", flush=True)
        mesh = read_mesh(Path(folder) / ("sheet.ply" if code else "surface.ply"))
    colours = np.tile(ORIGIN_COLOURS[INVENTED], (len(mesh.faces), 1)) if code else None
    return render(look_at(mesh.vertices, width_px=PIXELS, height_px=PIXELS), (Shape(vertices=mesh.vertices, faces=mesh.faces, colours=colours),))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=Path("real_clouds.png"))
    given = parser.parse_args()
    folder = Path(os.environ.get("SCAN2FEA_DATA", "."))
    files = given.files or [folder / "meshes" / "cgal_points" / name for name in FILES]
    canvas = Image.new("RGB", (PIXELS * len(files), PIXELS), "white")
    for k, file in enumerate(files):
        part = Image.fromarray(pictured(file)[..., :3])
        canvas.paste(part, (k * PIXELS, (PIXELS - part.height) // 2))
    canvas.quantize(64).save(given.out, optimize=True)
    print(f"{given.out} ({given.out.stat().st_size} bytes)")


if __name__ == "__main__":
    main()
