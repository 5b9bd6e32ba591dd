"""Scan to response, end to end: parts scanned with noise of 0.5 mm go through `scan2fea run`: do its tets bend and swing as the true solid?

    python benchmarks/end_to_end.py OUT.jsonl [--first K] [--seeds N] [--only KIND] [--cmd scan2fea]      a line each; goes on; prints the table

Both solids get the same problem, in the frame of the truth: held on the flat face at one end (nodes within 3 sigma of it: the root of a member, the
foot of the bracket, the rim of the tank), pushed sideways, both ways, over the last tenth at the other, growing to the end (tip: the mean motion so
weighted); free modes; mass. Members are seen all round, bracket and tank from 14 stations with known places.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from make_cases import Case, written

from scan2fea.cad import to_brep
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.fea.assemble import assemble
from scan2fea.fea.inner import InnerForces
from scan2fea.fea.linear import Shared, StaticSolver
from scan2fea.fea.restrain import rigid_fields
from scan2fea.fea.solve import _tree
from scan2fea.io import read_mesh
from scan2fea.kernel.measures import area
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid
from scan2fea.simulation import parts
from scan2fea.simulation.members import member
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.types import TetMesh

SIGMA_M = 0.0005
# between a true round wall and the flats that it is solved on: on flats of 3 mm the tets, 1.2 m long, would be needles, and the pipe 16 % too stiff
FLATS_M = {"CHS": 1e-4, "tank": 4e-4}
MEMBERS = {
    "L": {"a": 0.1, "b": 0.1, "t": 0.01, "length": 1.0},
    "I": {"h": 0.16, "b": 0.082, "tw": 0.0075, "tf": 0.0095, "length": 1.2},
    "C": {"h": 0.14, "b": 0.06, "tw": 0.007, "tf": 0.01, "length": 1.2},
    "RHS": {"h": 0.12, "b": 0.08, "t": 0.008, "length": 1.2},
    "CHS": {"d": 0.1143, "t": 0.01, "length": 1.2},
}
HOLES = [("a", 0.09, 0.03, 0.008), ("a", 0.09, 0.09, 0.008), ("b", 0.1, 0.06, 0.012)]
FIGURES = ("tip_x", "tip_y", "f7", "f8", "f9", "mass")


def part(kind: str, chord_m: float | None = None) -> tuple[Any, float, int]:
    """Shape, thinnest wall, axis of its length (of the tank turned round: its foot is its rim). chord_m : of round walls from their flats."""
    if kind in MEMBERS:
        return member(kind, MEMBERS[kind], chord_m or 2e-5), min(MEMBERS[kind].values()), 2
    if kind == "bracket":
        return parts.bracket(0.15, 0.16, 0.012, 0.12, HOLES, 2e-5), 0.012, 1
    return parts.tank(0.15, 0.4, 0.012, chord_m or 5e-5), 0.012, -1


def response(tets: TetMesh, axis: int) -> dict[str, float]:
    options = FeaOptions(member_cases=False)
    model = build_model(tets, options)
    modes = {c.measure: c.value for c in solve(model, options).cases if c.name == "modal"}
    system = assemble(model.mesh, model.material)
    nodes = np.asarray(model.mesh.nodes)
    along = -nodes[:, 2] if axis < 0 else nodes[:, axis]
    low, span = along.min(), np.ptp(along)
    held, tip = np.repeat((along <= low + 3 * SIGMA_M)[:, None], 3, 1), np.maximum(0.0, (along - low) / span - 0.9)
    weight = np.asarray(system.mass_matrix().sum(axis=1)).ravel() * tip
    weight /= weight.sum()
    solver = StaticSolver(
        system, Shared(system, _tree(model, system, None), options), rigid_fields(nodes), held, InnerForces(model.mesh, model.material), options
    )
    found = {"mass": float(system.mass.sum()), **{f"f{k}": modes[f"f{k}_hz"] for k in (7, 8, 9)}}
    for name, way in zip(("tip_x", "tip_y"), [k for k in range(3) if k != axis % 3], strict=True):
        force = np.zeros_like(nodes)
        force[:, way] = 100.0 * weight
        found[name] = float(weight @ solver.together({name: force})[name].displacement[:, way])
    return found


def run(kind: str, seed: int, command: str, truth: dict[str, float]) -> dict[str, Any]:
    rng = np.random.default_rng([seed, len(kind), ord(kind[0])])
    shape, wall, axis = part(kind)
    R, stations = quaternion_to_matrix(rng.standard_normal(4)), kind not in MEMBERS
    middle = (shape.mesh.vertices.min(0) + shape.mesh.vertices.max(0)) / 2
    T = rigid(R, (np.array([0, 0, 1.2]) if stations else rng.uniform(-4, 4, 3)) - R @ middle)
    n = round(area(shape.mesh) / (wall / (5 if stations else 2.5)) ** 2)
    case = Case(kind=kind, shape=shape, mesh=shape.mesh, T=T, sigma_m=SIGMA_M, noise="gauss", unit="m", n_points=n, stations=stations)
    row: dict[str, Any] = {"kind": kind, "seed": seed, "truth": truth}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(folder, kind, seed, case, rng)
        files = sorted(str(f) for f in folder.iterdir() if f.stem.startswith(("scan", "station")))
        began = time.perf_counter()
        ended = subprocess.run([*shlex.split(command), "run", *files, "-o", name + "/out"], capture_output=True, text=True, check=False)
        row |= {"exit": ended.returncode, "wall_s": time.perf_counter() - began}
        told = [o for o in json.loads((folder / "out/report.json").read_text())["objects"] if o["verdict"] == "converted"]
        if len(told) != 1:
            return {**row, "refused": ended.stdout[-400:]}
        row |= {"route": told[0]["route"], "family": told[0]["kind"]}
        made = read_mesh(folder / f"out/objects/{told[0]['id']:02d}/volume.vtu")
        row["ours"] = response(TetMesh(
            nodes=(made.nodes - T[:3, 3]) @ T[:3, :3], tets=made.tets, boundary=made.boundary, face_tag=made.face_tag, face_names=made.face_names
        ), axis)  # fmt: skip
    return row


def table(rows: list[dict[str, Any]]) -> None:
    print(f"| part | runs, converted | route | worst of {', '.join(FIGURES)} against the true solid, % | wall s |\n|---|---|---|---|---|")
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        good = [row for row in own if "ours" in row]
        worst = [max((100 * (r["ours"][f] / r["truth"][f] - 1) for r in good), key=abs, default=float("nan")) for f in FIGURES]
        routes = ", ".join(sorted({r["route"] for r in good}))
        print(f"| {kind} | {len(own)}, {len(good)} | {routes} | {', '.join(f'{w:+.2f}' for w in worst)} | {max(r['wall_s'] for r in own):.0f} |")


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("out", type=Path)
    ask.add_argument("--first", type=int, default=0, help="the first seed")
    ask.add_argument("--seeds", type=int, default=3)
    ask.add_argument("--only", default="")
    ask.add_argument("--cmd", default="scan2fea")
    given = ask.parse_args()
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    for kind in [k for k in (*MEMBERS, "bracket", "tank") if given.only in ("", k)]:
        missing = [seed for seed in range(given.first, given.first + given.seeds) if (kind, seed) not in {(r["kind"], r["seed"]) for r in rows}]
        if missing:
            shape, _, axis = part(kind, FLATS_M.get(kind))
            truth = response(fill(shape.mesh, to_brep(shape.mesh), FillOptions()).tets, axis)
        for seed in missing:
            rows.append(run(kind, seed, given.cmd, truth))
            with given.out.open("a") as stream:
                stream.write(json.dumps(rows[-1]) + "\n")
            print(json.dumps(rows[-1]), flush=True)
    table(rows)


if __name__ == "__main__":
    main()
