"""Repeatability of key points and features under noise and resampling: a table, and the picture of docs/registration.md.

    SCAN2FEA_DATA=DATA python benchmarks/keypoints.py [-o FILE.png]

One frame of each data set, in voxels as in registration. Its points are drawn again (noise along all axes; or a share of the points kept), the
frame is turned at random, and the key points are found anew. Repeated: key points of both that lie within 2 edges of one of the other, of all;
chance: as many rows drawn at random. Matched: of the repeated, those whose feature is nearest to that of the same place. Nothing is asserted.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from registration import bunny, demo, kitti
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.transforms import applied, inverse, random_rotation, rigid
from scan2fea.registration.features import features
from scan2fea.registration.ransac import Features, matched
from scan2fea.registration.surface import common_edge, surface_of
from scan2fea.types import FloatArray, PointCloud, Scan

NOISES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5)  # standard deviation by the edge of the voxels
SHARES = (1.0, 0.75, 0.5, 0.35, 0.25)  # of the points kept
NEAR_EDGES, SEEDS = 2.0, 3
COLOURS = ((20, 90, 160), (200, 80, 30), (40, 130, 60))


def repeated(first: FloatArray, again: FloatArray, reach: float) -> float:
    """Share of the points of two sets that lie near one of the other."""
    near = [(k_nearest(b, 1, a)[0][:, 0] <= reach).sum() for a, b in ((first, again), (again, first))]
    return float(sum(near) / (len(first) + len(again)))


def compared(points: FloatArray, edge: float, noise: float, share: float, seed: int) -> tuple[float, float, float]:
    """Repeated, by chance, matched."""
    rng = np.random.default_rng(seed)
    T = rigid(random_rotation(seed), rng.normal(size=3))
    drawn = points[np.sort(rng.permutation(len(points))[: round(share * len(points))])]
    drawn = applied(T, drawn + noise * edge * rng.standard_normal(drawn.shape))
    surfaces = [surface_of(Scan(cloud=PointCloud.of(p)), edge) for p in (points, drawn)]
    first, again = (features(s) for s in surfaces)
    back = Features(points=applied(inverse(T), again.points), frames=again.frames, values=again.values, variants=again.variants)
    by_chance = [s.points[rng.permutation(len(s))[: len(f.points)]] for s, f in zip(surfaces, (first, again), strict=True)]
    pairs = matched(back, first, 10**6)
    right = np.linalg.norm(back.points[pairs.source] - first.points[pairs.target], axis=1) <= NEAR_EDGES * edge
    may = (k_nearest(first.points, 1, back.points)[0][:, 0] <= NEAR_EDGES * edge).sum()
    return (
        repeated(first.points, back.points, NEAR_EDGES * edge),
        repeated(by_chance[0], applied(inverse(T), by_chance[1]), NEAR_EDGES * edge),
        len(np.unique(pairs.source[right])) / max(int(may), 1),
    )


def chart(curves: dict[str, dict[str, FloatArray]], path: Path) -> None:
    """Two panels: under noise, and with part of the points. Full lines repeated, dashed by chance, dotted matched."""
    picture = Image.new("RGB", (980, 400), "white")
    draw = ImageDraw.Draw(picture)
    for panel, (what, xs) in enumerate((("noise, voxel edges", NOISES), ("share of the points kept", SHARES))):
        left, top, wide, high = 60 + 490 * panel, 40, 390, 280
        low, span = min(xs), max(xs) - min(xs)
        place = [(left + wide * ((x - low) / span if panel == 0 else (max(xs) - x) / span)) for x in xs]
        for k in range(6):
            y = top + high * (1 - k / 5)
            draw.line((left, y, left + wide, y), fill=(225, 225, 225))
            draw.text((left - 40, y - 6), f"{20 * k} %", fill="black")
        for x, at in zip(xs, place, strict=True):
            draw.text((at - 8, top + high + 6), f"{x:g}", fill="black")
        draw.text((left, top + high + 24), what, fill="black")
        for colour, (name, of) in zip(COLOURS, curves.items(), strict=False):
            for column, dash in ((0, 0), (1, 8), (2, 3)):
                line = [(x, top + high * (1 - v)) for x, v in zip(place, of[what][:, column], strict=True)]
                for a, b in pairwise(line):
                    n = 1 if not dash else max(2, int(np.hypot(b[0] - a[0], b[1] - a[1]) / dash))
                    for k in range(0, n, 2):
                        draw.line([tuple(np.array(a) + (np.array(b) - a) * j / n) for j in (k, min(k + 1, n))], fill=colour, width=2)
            draw.text((left + 130 * list(curves).index(name), top + high + 46), name, fill=colour)
    draw.text((60, 12), "key points found again (full), as many rows at random (dashed), features matched to their place (dotted)", fill="black")
    picture.save(path, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", type=Path, default=Path("keypoints.png"))
    path = parser.parse_args().o
    curves: dict[str, dict[str, FloatArray]] = {}
    for name, scans in (("bunny", bunny()[0][:1]), ("kitti", kitti()[0][:1]), ("demo", demo()[0][:1])):
        points = scans[0].cloud.points
        edge, curves[name] = common_edge([points]), {}
        for what, cases in (("noise, voxel edges", [(s, 1.0) for s in NOISES]), ("share of the points kept", [(0.0, s) for s in SHARES])):
            rows = np.array([np.mean([compared(points, edge, *case, seed) for seed in range(SEEDS)], axis=0) for case in cases])
            curves[name][what] = rows
            for case, row in zip(cases, rows, strict=True):
                print(f"{name} noise {case[0]:.2f} edges, {case[1]:.0%} kept: repeated {row[0]:.0%} (chance {row[1]:.0%}), matched {row[2]:.0%}")
    chart(curves, path)


if __name__ == "__main__":
    main()
