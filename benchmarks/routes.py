"""Which way is chosen, and is what is built right? Members and free forms of make_cases.py, whole or cut along the member, through estimation alone.

    python benchmarks/make_cases.py CASES --n 60 --seed 7 [--points 9000]
    python benchmarks/routes.py CASES [--halves] [--state FILE]

A member is right where it is built (explained, all its checks passed) as its family with every observable dimension within 4 reported standard
deviations, or where it is refused and the data leave a dimension open (may_fail); built otherwise it is WRONG. A free form is right where it is
reconstructed; cylinders and boxes are members.
--halves: instead of the whole the points on either side of a plane along the member, through its middle, at an angle drawn from the case.
Each case is one line of the state file (JSON); a second call goes on where the first stopped.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path

import numpy as np

from scan2fea.estimation.member import MemberOptions
from scan2fea.io import InputOptions, read_scan
from scan2fea.pipeline.route import RouteOptions, estimate
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import member_checks

MEMBERS = {"L", "I", "C", "T", "RHS", "CHS", "rect", "round"}
PRISMS = {"box": "rect", "cylinder": "round"}  # free-form kinds that are members too
FLOOR_M = 5e-6  # scans are written with so many digits
CHORD = 4e-4  # of a diameter: make_cases.py draws circles as polygons whose sides lie that much inside


def points_of(folder: Path, truth: dict) -> np.ndarray:
    """Of all files of a case, metres, without the sensors: about the middle, so that map coordinates keep their digits."""
    parts = [read_scan(folder / name, InputOptions(unit=truth["unit"])).scan.cloud.points for name in truth["files"]]
    points = np.concatenate(parts)
    return points - points.mean(axis=0)


def pieces(points: np.ndarray, truth: dict, halves: bool) -> dict[str, np.ndarray]:
    if not halves:
        return {"whole": points}
    along = np.array(truth["objects"][0]["rotation"])[:, 2]
    across = np.random.default_rng(list(truth["id"].encode())).standard_normal(3)
    across -= along * (across @ along)
    side = (points - np.median(points, axis=0)) @ across > 0
    return {"left": points[side], "right": points[~side]}


def judged(points: np.ndarray, truth: dict) -> dict:
    """Route, family, and the dimension that is off by the most of its standard deviations."""
    begun = time.process_time()
    found = estimate(Scan(cloud=PointCloud.of(points)), MemberOptions(), RouteOptions())
    row = {"seconds": time.process_time() - begun, "n": len(points), "explains": found.explains, "reason": found.reason[:160]}
    member = found.member
    if member is None:
        return {**row, "built": False}
    checks = member_checks(member, found.explains)
    row |= {"built": all(c.passed for c in checks), "family": member.family, "failed": [c.name for c in checks if not c.passed]}
    real = truth["objects"][0]
    wanted = real["family"] if real["family"] in MEMBERS else PRISMS.get(real["name"], "")
    if member.family != wanted or real["name"] in PRISMS:
        return row
    off = {}
    for p in member.parameters:
        if p.observable and p.std_m is not None:
            ways = [real["params_m"][p.name]]
            if p.name in ("a", "b", "h") and wanted in ("RHS", "rect", "L"):  # sides that carry no order
                ways += [real["params_m"][q] for q in ("a", "b", "h") if q in real["params_m"]]
            away = min(abs(p.value_m - w) for w in ways)
            if p.name == "d" and -CHORD < p.value_m / ways[0] - 1 < 0:
                away = 0.0
            off[p.name] = away / (p.std_m + FLOOR_M)
    return {**row, "off": {k: round(v, 2) for k, v in off.items()}, "worst": max(off.values(), default=0.0)}


def verdict(row: dict) -> str:
    wanted = row["wanted"]
    if not row["built"]:
        return "right" if not wanted or row.get("may_fail") else "refused"
    if not wanted or row["family"] != wanted:
        return "WRONG"
    return "WRONG" if row.get("worst", 0.0) > 4 else "right"


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    given.add_argument("cases", type=Path)
    given.add_argument("--halves", action="store_true")
    given.add_argument("--state", type=Path, default=Path("routes.jsonl"))
    chosen = given.parse_args()
    rows = [json.loads(line) for line in chosen.state.read_text().splitlines()] if chosen.state.exists() else []
    done = {(row["id"], row["piece"]) for row in rows}
    for path in sorted(chosen.cases.glob("*/truth.json")):
        truth = json.loads(path.read_text())
        real = truth["objects"][0]
        wanted = real["family"] if real["family"] in MEMBERS else PRISMS.get(real["name"], "")
        for name, points in pieces(points_of(path.parent, truth), truth, chosen.halves).items():
            if (truth["id"], name) in done:
                continue
            row = {"id": truth["id"], "piece": name, "title": truth["title"], "kind": real["name"], "wanted": wanted}
            row |= {"may_fail": truth["expect"] == "may_fail", **judged(points, truth)}
            row["verdict"] = verdict(row)
            rows.append(row)
            with chosen.state.open("a") as state:
                state.write(json.dumps(row) + "\n")
            says = row.get("failed") or row.get("off") or ""
            head = f"{row['id']} {name:5s} {row['verdict']:7s} {row.get('family', '-'):5s} {row['seconds']:5.1f} s"
            print(f"{head}  {row['title'][:70]}  {says}", flush=True)
    for kind in ("member", "free form"):
        count = Counter(row["verdict"] for row in rows if bool(row["wanted"]) == (kind == "member"))
        print(f"{kind}: {dict(count)}; CPU {np.mean([r['seconds'] for r in rows if bool(r['wanted']) == (kind == 'member')] or [0]):.2f} s each")


if __name__ == "__main__":
    main()
