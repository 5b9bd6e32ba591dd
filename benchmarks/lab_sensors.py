"""The thesis's lab seen by cameras, a stereo rig, a line laser and ultrasound, through `scan2fea run`: which dimensions of the beam does each tell?

    python benchmarks/lab_sensors.py OUT [--only photogrammetry,stereo,line_laser,ultrasonic] [--seed 0]

Every sensor goes where one who wants the beam would take it: pictures from an oval around it, four passes of the line laser along it, and four of
the ultrasonic sensor. Printed: what report.json says of the beam (L 127 x 127 x 6.35, 3048 mm) beside the truth. Nothing is asserted;
the table is in docs/acquisition.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from scan2fea.pipeline.simulate import simulate_scene
from scan2fea.simulation.lab17 import lab17
from scan2fea.simulation.line_laser import LineLaserOptions
from scan2fea.simulation.photogrammetry import PhotogrammetryOptions, StereoOptions
from scan2fea.simulation.scene_file import PlacedSensor, SceneFile
from scan2fea.simulation.ultrasonic import UltrasonicOptions

TRUE = {"a": 127.0, "b": 127.0, "t": 6.35, "length": 3048.0}
BEAM = np.array([1.7, 0.55, 0.9])  # middle of the beam, which lies along x
LONG = 1.9  # half of a way along the beam, m


def looking_at(places: list[np.ndarray], targets: list[np.ndarray], roll_deg: float = 0.0) -> dict[str, tuple[tuple[float, float, float], ...]]:
    """Options of sensors at `places` (m) that look at `targets` (m)."""
    ways = [t - p for p, t in zip(places, targets, strict=True)]
    turns = [(roll_deg, float(np.degrees(-np.arctan2(w[2], np.hypot(w[0], w[1])))), float(np.degrees(np.arctan2(w[1], w[0])))) for w in ways]
    return {"positions_m": tuple(tuple(map(float, p)) for p in places), "orientations_deg": tuple(turns)}


def rings(n: int) -> dict[str, tuple[tuple[float, float, float], ...]]:
    """n places on an oval around the beam, by turns from below and from above, each looking at the stretch of the beam beside it."""
    angle = 2 * np.pi * np.arange(n) / n
    height = np.where(np.arange(n) % 2, 2.3, 0.35)
    places = [BEAM + np.array([2.6 * np.cos(a), 2.0 * np.sin(a), 0.0]) for a in angle]
    places = [np.array([*p[:2], h]) for p, h in zip(places, height, strict=True)]
    return looking_at(places, [BEAM + np.array([0.9 * np.cos(a), 0.0, 0.0]) for a in angle])


def passes(kind: str) -> list[dict[str, object]]:
    """Ways along the beam, 0.6 to 0.7 m away: from above and from below, on either side. The sheet of a line laser stands across the beam."""
    found: list[dict[str, object]] = []
    for dy, dz in ((-0.6, 0.35), (0.6, 0.35), (-0.35, -0.5), (0.35, -0.5)):
        ends = [BEAM + np.array([x, dy, dz]) for x in (-LONG, LONG)]
        options = looking_at(ends, [np.array([e[0], *BEAM[1:]]) for e in ends], 90.0 if kind == "line_laser" else 0.0)
        found.append({**options, "times_s": (0.0, 20.0 if kind == "line_laser" else 40.0)})
    return found


def sensors(kind: str) -> list[object]:
    if kind == "photogrammetry":
        return [PhotogrammetryOptions(**rings(36), features_per_m2=40_000, bare_share=0.0)]
    if kind == "stereo":
        return [StereoOptions(**rings(36), features_per_m2=40_000, bare_share=0.0)]
    if kind == "line_laser":
        return [LineLaserOptions(**way) for way in passes(kind)]
    return [UltrasonicOptions(**way) for way in passes(kind)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", default="photogrammetry,stereo,line_laser,ultrasonic")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    for kind in args.only.split(","):
        given = SceneFile(scene=lab17(args.seed), sensors=tuple(PlacedSensor(kind=kind, options=o) for o in sensors(kind)), sampling=None)
        made = simulate_scene(given, args.out / f"{kind}_scan", seed=args.seed, step=False)
        near = "[" + ", ".join(f"{x:.3g}" for x in BEAM) + "]"
        begin = time.perf_counter()
        command = [sys.executable, "-m", "scan2fea", "run", *map(str, made.files), "-o", str(args.out / kind), "--set", f"select.near_m={near}"]
        code = subprocess.run([*command, "--set", "registration.mode=placed"], capture_output=True, text=True, check=False)
        told(kind, args.out / kind / "report.json", code, time.perf_counter() - begin)


def told(kind: str, report: Path, code: subprocess.CompletedProcess[str], seconds: float) -> None:
    print(f"{kind}: exit {code.returncode}, {seconds:.0f} s {code.stderr.strip().splitlines()[-1:] if code.returncode else ''}")
    if not report.exists():
        return
    for item in json.loads(report.read_text())["objects"]:
        print(f"  object {item['id']}: {item.get('n_points')} points, {item['verdict']}: {item.get('reason')}")
        for name, p in ((item.get("member") or {}).get("parameters") or {}).items():
            std = p["std_m"] if p["observable"] else p.get("spread_m")
            how = "observable" if p["observable"] else f"not observable ({p['source']})"
            print(f"    {name}: {how}, {1e3 * p['value_m']:.2f} +- {1e3 * (std or 0):.2f} mm, true {TRUE.get(name)}")


if __name__ == "__main__":
    main()
