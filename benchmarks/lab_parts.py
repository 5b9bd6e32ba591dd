"""Bracket, tube, plate girder, tank, blob at three spacings and noises, a fifth of the points hidden: python benchmarks/lab_parts.py [--jobs N].

What is hidden lies in three shadows, each thrown by something that stands in the sight line of one sensor: all that this sensor sees through a cone
is gone, nearer faces and rims alike, but not what lies behind them; or (`--balls`) in three balls, where all faces that look the same way within a
right angle are gone, one behind the other too. With sensor positions and without (`--blind`). One row per case: closed, holes that go through
(truth), volume, F-score at two spacings, p95 of the distances both ways in spacings, what refused it. The last lines count, and give the median
and the worst of what was passed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from closed_cases import occluded
from seeded import rows

from predicates import moved, rotation, two_sided
from reconstruction import blob
from scan2fea.errors import ReconstructionError
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.simulation.girder import girder_mesh
from scan2fea.simulation.shapes import bracket, chs, tank
from scan2fea.types import PointCloud, Scan, TriangleMesh
from scanned import scan_of, scanned

PARTS = {  # the exact solid, its wall, m
    "bracket": (lambda: bracket(0.14, 0.12, 0.012, 0.1, [("a", 0.08, 0.05, 0.016), ("b", 0.07, 0.05, 0.014)], 0.0002), 0.012),
    "tube": (lambda: chs(0.06, 0.004, 0.25, 0.0001), 0.004),
    "girder": (lambda: girder_mesh(0.3, 0.15, 0.008, 0.012, 0.6, 0.008, 0.06, 2), 0.008),
    "tank": (lambda: tank(0.15, 0.4, 0.012, 0.0004), 0.012),
    "blob": (lambda: moved(blob(), 0.3 * np.eye(3), np.zeros(3)), 0.04),
}
SPACINGS = (0.35, 0.5, 0.7)  # of the wall
NOISES = (0.0, 0.05, 0.1)  # of the wall
HIDDEN, SHADOWS = 0.2, 3  # of the points, in so many shadows
LARGEST_POINTS = 60_000
RIGHT, LEAST_F = 0.02, 0.97  # volume off, F-score at two spacings


def genus(mesh: TriangleMesh) -> int:
    """Holes that go through all shells together: chi = 2 C - 2 G."""
    topology = surface_topology(mesh)
    edges = 3 * len(mesh.faces) // 2
    return topology.n_components - (len(mesh.vertices) - edges + len(mesh.faces)) // 2


def shadowed(scan: Scan, places: np.ndarray, normals: np.ndarray, truth: TriangleMesh, share: float, rng: np.random.Generator) -> Scan:
    """The scan without the points in shadows that hold `share` of all. places, normals : (n, 3) exact."""
    points, sensors, scene = scan.cloud.points, scan.sensors(), scene_of(truth)
    keep = np.ones(len(points), bool)
    size = float(np.ptp(truth.vertices, axis=0).max())
    for sensor_of in rng.choice(np.flatnonzero(np.isfinite(sensors).all(axis=1)), SHADOWS, replace=False):
        way = sensors[sensor_of] - places
        distance = np.linalg.norm(way, axis=1)
        way /= distance[:, None]
        facing = np.flatnonzero(keep & (np.einsum("ij,ij->i", way, normals) > 0))
        seen = facing[first_hits(scene, places[facing] + 1e-6 * size * normals[facing], way[facing])[1] < 0]
        off_axis = np.linalg.norm(way[seen] - way[sensor_of], axis=1)
        keep[seen[np.argsort(off_axis, kind="stable")[: int(share / SHADOWS * len(points))]]] = False
    return scan_of(points[keep], sensors[keep])


def case(name: str, spacing: float, noise: float, hidden: float, how: str, seed: int) -> tuple[TriangleMesh, Scan]:
    """The exact part, and its scan. how : "shadows", "balls", or "blind" (shadows, the sensors not told)."""
    make, wall = PARTS[name]
    truth = moved(make(), rotation(seed), np.zeros(3))
    scan, places, normals = scanned(truth, spacing * wall, noise * wall, seed=seed)
    rng = np.random.default_rng(seed)
    if hidden:
        scan = occluded(scan, normals, hidden, rng) if how == "balls" else shadowed(scan, places, normals, truth, hidden, rng)
    return truth, Scan(cloud=PointCloud.of(scan.cloud.points)) if how == "blind" else scan


def row(name: str, spacing: float, noise: float, hidden: float, how: str, seed: int) -> dict[str, Any]:
    truth, scan = case(name, spacing, noise, hidden, how, seed)
    wall = PARTS[name][1]
    begin = time.process_time()
    try:
        found = reconstruct(scan, ReconstructionOptions(max_points=LARGEST_POINTS))
    except ReconstructionError as error:
        return {"n": len(scan.cloud), "end": "no surface", "refused": str(error)}
    seconds = time.process_time() - begin
    there, back = two_sided(found.mesh, truth)
    near = 2.0 * spacing * wall
    precise, complete = float((there <= near).mean()), float((back <= near).mean())
    topology = surface_topology(found.mesh)
    refused = "; ".join(f"{check.name} {check.value:.3g}" for check in found.checks if not check.passed)
    return {
        "n": len(scan.cloud),
        "sound": bool(topology.is_clean and not len(self_intersections(found.mesh))),
        "genus": [genus(found.mesh), genus(truth)],
        "volume": volume(found.mesh) / volume(truth),
        "f": 2 * precise * complete / max(precise + complete, 1e-300),
        "p95": [float(np.percentile(d, 95)) / (spacing * wall) for d in (there, back)],
        "seconds": round(seconds, 1),
        "how": f"{found.how['method']}, {found.source}",
        "refused": refused,
        "end": "refused" if refused else "passed",
    }


def told(r: dict[str, Any]) -> str:
    name, spacing, noise, hidden, how, seed = r["case"]
    head = f"{name:8s} h {spacing:.2f} noise {noise:.2f} hidden {hidden:.1f} {how} seed {seed} {r['n']:6d}"
    if "volume" not in r:
        return f"{head}  {r['end']}: {r['refused']}"
    figures = f"volume {r['volume']:.4f}  F {r['f']:.4f}  holes {r['genus'][0]} of {r['genus'][1]}  p95 {r['p95'][0]:.2f} / {r['p95'][1]:.2f} h"
    return f"{head}  {'sound' if r['sound'] else 'UNSOUND'}  {figures}  {r['seconds']:5.1f} s  {r['how']}  {r['end']} {r['refused']}"


def summary(found: list[dict[str, Any]]) -> str:
    made, passed = [r for r in found if "volume" in r], [r for r in found if r["end"] == "passed"]
    ends = Counter(r["end"] for r in found)
    text = f"{len(found)} cases: {dict(ends)}; unsound {sum(not r['sound'] for r in made)}"
    if passed:
        off = np.array([abs(r["volume"] - 1) for r in passed])
        text += f"; of the passed: volume off by {np.median(off):.2%} (median), {off.max():.2%} (worst), F at least {min(r['f'] for r in passed):.4f}"
        text += f", holes wrong in {sum(r['genus'][0] != r['genus'][1] for r in passed)}"
        right = [r for r in passed if abs(r["volume"] - 1) <= RIGHT and r["f"] >= LEAST_F and r["genus"][0] == r["genus"][1]]
        text += f"; passed and right (volume within {RIGHT:.0%}, F {LEAST_F}, holes) {len(right)} of {len(found)}"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=list(PARTS), help=f"of {', '.join(PARTS)}")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--blind", action="store_const", const="blind", dest="how", default="shadows", help="without sensor positions")
    kind.add_argument("--balls", action="store_const", const="balls", dest="how", help="balls of one side hidden, in place of shadows")
    parser.add_argument("--hidden", type=float, default=HIDDEN, help="share of the points")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--state", type=Path, help="file of finished rows, read and continued")
    args = parser.parse_args()
    cases = [(p, h, s, args.hidden, args.how, k) for p in args.parts for h in SPACINGS for s in NOISES for k in range(args.seeds)]
    found = []
    for r in rows(row, cases, args.jobs, args.state):
        print(told(r), flush=True)
        found.append(r)
    print(summary(found))


if __name__ == "__main__":
    main()
