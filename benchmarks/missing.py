"""Hunt for solids that are passed though part of the scan is missing.

    python benchmarks/missing.py [--cases N] [--first SEED] [--jobs N] [--rows FILE]

Parts with walls in random poses and units; points taken away on BOTH sides of what they lie on: balls, half-spaces, slabs, bores, whole faces, or
what one look does not see. Judged by the exact truth: what passes every gate must be within 3 % of its volume (5 % with noise), or within
what it was told to be in doubt ("told": at most 5 %). A surface cannot know what nobody saw, so refusals are right here; rows say how far off the
refused ones were. With --rows finished cases are read back and not run again.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from seeded import rows

from predicates import moved, rotation
from reconstruction import PARTS
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction import METHODS, ReconstructionOptions, reconstruct
from scan2fea.reconstruction.budget import VOLUME_IN_DOUBT
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.simulation.shapes import tank
from scan2fea.types import PointCloud, Scan, TriangleMesh
from scanned import scan_of, scanned


def channel() -> TriangleMesh:
    h, b, t = 0.5, 0.3, 0.05
    return meshed(prism([[0, 0], [b, 0], [b, t], [t, t], [t, h - t], [b, h - t], [b, h], [0, h]], 1.0))


SHAPES = {name: PARTS[name] for name in ("cup", "angle", "ibeam", "bracket", "tee", "tube", "plate", "frame", "block", "cylinder")}
SHAPES |= {"channel": channel, "tank": lambda: tank(0.4, 0.9, 0.06, 0.001)}
WALLS = {"cup": 0.08, "angle": 0.15, "ibeam": 0.04, "bracket": 0.06, "tee": 0.08, "tube": 0.07, "plate": 0.05, "frame": 0.09, "block": 0.2}
WALLS |= {"cylinder": 0.2, "channel": 0.05, "tank": 0.06}
LARGEST_H = 0.04
KINDS = ("none", "ball", "balls", "half", "slab", "bore", "face", "rim ball", "look")
RIGHT, RIGHT_NOISY = 0.03, 0.05


def removed(kind: str, points: np.ndarray, normals: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """(n,) points that are missing."""
    n, way = len(points), rng.normal(size=3)
    way /= np.linalg.norm(way)
    if kind == "none":
        return np.zeros(n, bool)
    if kind in ("ball", "balls", "rim ball"):
        count = 3 if kind == "balls" else 1
        gone = np.zeros(n, bool)
        for _ in range(count):
            middle = points[rng.integers(n)] if kind != "rim ball" else points[np.argmax(points @ way)]
            distance = np.linalg.norm(points - middle, axis=1)
            gone |= distance <= np.quantile(distance, share / count)
        return gone
    if kind == "half":
        return points @ way > np.quantile(points @ way, 1 - share)
    if kind == "slab":
        off = np.abs(points @ way - rng.choice(points @ way))
        return off <= np.quantile(off, share)
    if kind == "bore":
        from_axis = points - points[rng.integers(n)]
        off = np.linalg.norm(from_axis - (from_axis @ way)[:, None] * way, axis=1)
        return off <= np.quantile(off, share)
    if kind == "face":  # one flat face, or one side of a bent one
        own = normals[rng.integers(n)]
        return normals @ own > 0.97
    return normals @ way > 0.1  # "look": all that faces one way


def case(seed: int) -> tuple[str, TriangleMesh, Scan, dict[str, object]]:
    rng = np.random.default_rng(10_000 + seed)
    name, kind = list(SHAPES)[seed % len(SHAPES)], KINDS[int(rng.integers(len(KINDS)))]
    size = float(10.0 ** rng.uniform(-2, 4))
    truth = moved(SHAPES[name](), size * rotation(seed), size * rng.uniform(-5, 5, 3))
    spacing = min(float(rng.uniform(0.3, 0.7)) * WALLS[name], LARGEST_H)
    noise, share = float(rng.choice([0.0, 0.0, 0.1, 0.2])), float(rng.uniform(0.02, 0.6) if rng.integers(2) else rng.uniform(0.01, 0.1))
    scan, places, normals = scanned(truth, spacing * size, noise * WALLS[name] * size, seed=seed)
    keep = ~removed(kind, places, normals, share, rng)
    blind = bool(rng.integers(3))
    scan = Scan(cloud=PointCloud.of(scan.cloud.points[keep])) if blind else scan_of(scan.cloud.points[keep], scan.sensors()[keep])
    return name, truth, scan, {"h": spacing, "noise": noise, "kind": kind, "gone": float(1 - keep.mean()), "blind": blind, "size": size}


def row(seed: int, method: str) -> dict[str, object]:
    """What became of a case: `end` is "right", "told", "refused", "no surface" or "WRONG"."""
    name, truth, scan, facts = case(seed)
    out: dict[str, object] = {"seed": seed, "part": name, "n": len(scan.cloud), **facts}
    begin = time.process_time()
    try:
        found = reconstruct(scan, ReconstructionOptions(method=method))
    except ReconstructionError as error:
        return {**out, "end": "no surface", "refused": str(error)[:80]}
    out["seconds"] = round(time.process_time() - begin, 2)
    out["ratio"] = volume(found.mesh) / volume(truth)
    out["refused"] = "; ".join(f"{c.name} {c.value:.3g}" for c in found.checks if not c.passed)
    out["checks"] = {c.name: round(c.value, 4) for c in found.checks}
    off = abs(out["ratio"] - 1)
    passed = "right" if off <= (RIGHT_NOISY if facts["noise"] else RIGHT) else "told" if off <= out["checks"][VOLUME_IN_DOUBT] else "WRONG"
    how = {name: str(found.how.get(name, "")) for name in ("method", "not_planar")}
    return {**out, "how": how["method"], "not_planar": how["not_planar"], "end": "refused" if out["refused"] else passed}


def told(r: dict[str, object]) -> str:
    side = "blind" if r["blind"] else "seen"
    head = f"{r['seed']:4} {r['part']:9s} {r['kind']:8s} gone {r['gone']:.2f} noise {r['noise']:.1f} {side:5s} {r['n']:6d}"
    return f"{head}  volume {r.get('ratio', float('nan')):.3f}  {r.get('seconds', 0):5.1f} s  {r['end']}  {r['refused']}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--only", type=int, nargs="*", help="these seeds")
    parser.add_argument("--rows", type=Path, help="file of finished cases, read and continued")
    parser.add_argument("--method", default="visibility", choices=list(METHODS))
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    ends: Counter[str] = Counter()
    cases = [(seed, args.method) for seed in args.only or range(args.first, args.first + args.cases)]
    for found in rows(row, cases, args.jobs, args.rows):
        ends[str(found["end"])] += 1
        print(told(found), flush=True)
    print(f"{args.method}: " + ", ".join(f"{count} {end}" for end, count in sorted(ends.items())))
    return 1 if ends["WRONG"] else 0


if __name__ == "__main__":
    sys.exit(main())
