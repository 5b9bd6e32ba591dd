"""Members at the statistical limit: RMSE over the Cramer-Rao bound, bias and coverage of every dimension, families, length, sag and time.

    python benchmarks/estimation.py [--quick] [--seeds N] [--jobs N] [--seconds S] [--state FILE] [--only NAME,...]

Each run of a cell is one line of the state file (JSON); a second call goes on where the first stopped, and prints the table from what is there.
Whenever it ends (--seconds: of wall time) every cell has the same part of its seeds: 100 of the thin L and the block, 20 of the others.
"""

from __future__ import annotations

import argparse
import time
import zlib
from functools import partial
from pathlib import Path

import numpy as np
from in_parallel import ordered, read_state, run_all

from scan2fea.errors import Scan2FeaError
from scan2fea.estimation.catalogued import catalogued
from scan2fea.estimation.closest_point import closest_point
from scan2fea.estimation.member import MemberFit, MemberOptions, fit_member
from scan2fea.estimation.table import Shape, Table, shipped_table
from scan2fea.estimation.visible import visible_sets
from scan2fea.kernel.section_likelihood import face_lengths, faces, information
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import member_checks

THIN = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
BLOCK = {"a": 0.254, "b": 0.254, "t": 0.127, "length": 1.0}
SHAPES = {
    "L": {"a": 0.15, "b": 0.1, "t": 0.012, "length": 1.8},
    "I": {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085, "length": 1.8},
    "C": {"h": 0.16, "b": 0.065, "tw": 0.0075, "tf": 0.0105, "length": 1.5},
    "T": {"h": 0.1, "b": 0.1, "tw": 0.011, "tf": 0.011, "length": 1.2},
    "RHS": {"h": 0.15, "b": 0.1, "t": 0.008, "length": 1.6},
    "CHS": {"d": 0.1683, "t": 0.01, "length": 1.6},
    "rect": {"b": 0.12, "t": 0.02, "length": 1.2},
    "round": {"d": 0.06, "length": 0.9},
}


def cells(quick: bool) -> dict[str, dict]:
    """Name -> what is scanned and how."""
    out: dict[str, dict] = {}
    for sigma in (0.0005, 0.002, 0.0067, 0.02):
        for n in (3_000, 20_000) if quick else (3_000, 20_000, 200_000):
            out[f"thin L, {1e3 * sigma:g} mm, {n}"] = {"family": "L", "values": THIN, "sigma": sigma, "n": n}
    out["block of Fig 3.6, 25.4 mm, 3000"] = {"family": "L", "values": BLOCK, "sigma": 0.0254, "n": 3_000}
    out["thin L, 0 mm, 3000"] = {"family": "L", "values": THIN, "sigma": 0.0, "n": 3_000, "caps": True}
    out["thin L, uniform 20 mm, 20000"] = {"family": "L", "values": THIN, "sigma": 0.02 / 3**0.5, "n": 20_000, "noise": "uniform"}
    out["thin L, 5 mm sag, 20 mm, 20000"] = {"family": "L", "values": THIN, "sigma": 0.02, "n": 20_000, "bow": ((-0.01 / 3,), (0.0,))}
    for family, values in SHAPES.items():
        for scale in (1.0,) if quick else (0.5, 0.75, 1.0, 1.5, 2.5):
            for share in (0.002, 0.01, 0.03):
                size = {k: v * scale for k, v in values.items()}
                wide = max(v for k, v in size.items() if k != "length")
                out[f"{family} x{scale:g}, noise {share:g} of the section, clutter"] = {
                    "family": family, "values": size, "sigma": share * wide, "n": 8_000, "clutter": 0.15, "caps": family in ("rect", "round"),
                }  # fmt: skip
                out[f"{family} x{scale:g}, noise {share:g} of the section, clutter, half hidden"] = {
                    "family": family, "values": size, "sigma": share * wide, "n": 8_000, "clutter": 0.15, "caps": True,
                    "faces": least_seen(family, size),
                }  # fmt: skip
    return out


def least_seen(family: str, values: dict) -> tuple[str, ...]:
    """Of the sets of faces that sensors may see, that of the shortest outline which is still 40 % of all of it."""
    own = {name: values[name] for name in PARAMETERS[family]}
    length = dict(zip(faces(family), face_lengths(family, np.array(list(own.values()))), strict=True))
    share = {one: sum(length[name] for name in one) / sum(length.values()) for one in visible_sets(family, own)}
    return min((one for one in share if share[one] >= 0.4), key=lambda one: (share[one], one))


def run(cell: dict, seed: int, baseline: bool) -> dict:
    """One scan of a cell, fitted."""
    family, values = cell["family"], cell["values"]
    draw = zlib.crc32(repr((sorted(cell.items(), key=str), seed)).encode())  # no two cells see the same noise: they are pooled
    options = MemberScanOptions(
        noise_m=cell["sigma"], noise=cell.get("noise", "gaussian"), clutter=cell.get("clutter", 0.0), caps=cell.get("caps", False), seed=draw,
        faces=cell.get("faces", ()),
    )  # fmt: skip
    straight = member_points(family, values, cell["n"], options, cell.get("bow", ((), ())))
    points = straight @ random_rotation(np.random.default_rng([draw, 1])).T
    begun = time.process_time()
    try:
        found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    except Scan2FeaError as error:
        return {"seed": seed, "error": str(error), "seconds": time.process_time() - begun}
    seconds = time.process_time() - begun
    row = {
        "seed": seed, "seconds": seconds, "family": found.member.family, "explains": found.explains, "noise": found.member.noise,
        "built": all(check.passed for check in member_checks(found.member, found.explains)), "belief": found.member.families.get(family, 0.0),
        "values": found.member.values(), "std": {p.name: p.std_m for p in found.member.parameters},
        "sag": float(np.linalg.norm(found.sag_m)),
    }  # fmt: skip
    if not all(p.observable for p in found.member.parameters) and family == found.member.family:
        row["stand_in"] = {name: built_with(found, table) for name, table in (("shipped", None), ("with the size", _with_size(family, values)))}
    if baseline:
        start = {name: 0.9 * values[name] for name in PARAMETERS[family]}
        row["closest"] = dict(closest_point(straight, family, start).values)
    return row


def built_with(found: MemberFit, table: Table | None) -> dict[str, float]:
    """Dimensions that the points do not tell, as they are built with that catalogue, and how far off they may be."""
    try:
        return {p.name: (p.value_m, p.spread_m) for p in catalogued(found.member, table).parameters if not p.observable}
    except Scan2FeaError:
        return {}


def _with_size(family: str, values: dict) -> Table:
    """The shipped sizes of the family and the very one that was scanned."""
    size = {name: values[name] for name in PARAMETERS[family]}
    own = Shape(family=family, name="scanned", standard="none", parameters=size, root_radius_m=float("nan"))
    return Table(shapes=(*shipped_table().of(family), own), source="benchmark")


def bound(cell: dict) -> dict[str, float]:
    """Cramer-Rao bound of the dimensions and of the length (two edges, each 0.903 rho / sigma)."""
    n = cell["n"] * (1 - cell.get("clutter", 0.0))
    names = PARAMETERS[cell["family"]]
    values = np.array([cell["values"][name] for name in names])
    sd = dict(information(cell["family"], values, cell["sigma"]).sd(int(n))) if cell["sigma"] > 0 else dict.fromkeys(names, float("nan"))
    sd["length"] = float(np.sqrt(2 * cell["sigma"] * cell["values"]["length"] / (0.903 * n)))
    return {name: float(np.nan_to_num(sd[name])) for name in (*names, "length")}


def table(cell_of: dict[str, dict], rows: dict[str, list[dict]]) -> None:
    print(f"{'cell':46s} {'n':>3s} {'family':>6s} {'s CPU':>6s}  dimension: bias mm, RMSE/CRB, cover 95 %, told %, closest-point bias mm")
    for name, cell in cell_of.items():
        done = rows.get(name, [])
        good = [r for r in done if r.get("family") == cell["family"]]
        if not done:
            continue
        limit = bound(cell)
        parts = []
        for key, sd in limit.items():
            error = np.array([r["values"][key] - cell["values"][key] for r in good])
            told = np.array([r["std"][key] is not None for r in good], bool)
            std = np.array([r["std"][key] or np.nan for r in good])
            if not told.any():
                parts.append(f"{key}: not told{stand_ins(good, key, cell)}")
                continue
            rmse = float(np.sqrt(np.mean(error[told] ** 2)))
            cover = float(np.mean(np.abs(error[told]) < 1.96 * std[told]))
            base = [r["closest"][key] - cell["values"][key] for r in good if key in r.get("closest", {})]
            closest = f" ({1e3 * np.mean(base):+.1f})" if base else ""
            ratio = f"{rmse / sd:.2f}" if sd > 0 else f"{1e3 * rmse:.5f} mm"
            parts.append(f"{key}: {1e3 * error[told].mean():+.2f} {ratio} {cover:.2f} {100 * told.mean():.0f}{closest}")
        right = 100 * len(good) / len(done)
        print(f"{name:46s} {len(done):3d} {right:5.0f}% {np.mean([r['seconds'] for r in done]):6.2f}  " + "; ".join(parts))
        if "bow" in cell and good:
            error = np.array([r["sag"] for r in good]) - 0.005
            crb = 3.354 * 2**0.5 * cell["sigma"] / cell["n"] ** 0.5
            print(f"{'':46s} sag: bias {1e3 * error.mean():+.2f} mm, RMSE/CRB {np.sqrt(np.mean(error**2)) / crb:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer sizes and points, three seeds")
    parser.add_argument("--seeds", type=int, default=0, help="of every cell; -1: only the table of what is there")
    parser.add_argument("--only", default="", help="cells whose name holds one of these, with commas between")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="wall time after which no further run begins")
    parser.add_argument("--state", type=Path, default=Path("estimation.jsonl"))
    args = parser.parse_args()
    chosen = {name: cell for name, cell in cells(args.quick).items() if any(part in name for part in args.only.split(","))}
    wanted = {name: args.seeds or (3 if args.quick else 100 if name.startswith(("thin", "block")) else 20) for name in chosen}
    if args.seeds >= 0:
        todo = ordered(wanted, lambda name: chosen[name]["n"], read_state(args.state))
        run_all(todo, partial(one_run, chosen), args.state, jobs=args.jobs, seconds=args.seconds)
    rows = read_state(args.state)
    table(chosen, rows)
    pooled(chosen, rows)


def stand_ins(good: list[dict], key: str, cell: dict) -> str:
    """How near what is built comes to a wall that is not told: share within 2 mm and within twice its spread, by catalogue."""
    said = []
    for name in ("shipped", "with the size"):
        rows = np.array([r["stand_in"][name][key] for r in good if key in r.get("stand_in", {}).get(name, {})], float).reshape(-1, 2)
        if len(rows):
            off = np.abs(rows[:, 0] - cell["values"][key])
            near, held = np.mean(off < 0.002), np.mean(off < 2 * rows[:, 1])
            said.append(f"{name}: {np.median(rows[:, 0]) * 1e3:.2f} mm, {near:.2f} within 2 mm, {held:.2f} within twice its spread")
    return f" (built with, catalogue {'; '.join(said)})" if said else ""


def one_run(chosen: dict[str, dict], what: tuple[str, int]) -> dict:
    """One line of the state file."""
    name, seed = what
    cell = chosen[name]
    return {"cell": name, **run(cell, seed, baseline=seed < 10 and name.startswith(("thin", "block")) and cell["n"] <= 20_000)}


def pooled(cell_of: dict[str, dict], rows: dict[str, list[dict]]) -> None:
    """Per family over all its cells with clutter: right family, a wrong one that was built, and how the intervals hold."""
    for hidden in (False, True):
        for family in SHAPES:
            names = [name for name in cell_of if name.startswith(f"{family} x") and ("faces" in cell_of[name]) == hidden]
            own = [(cell_of[name], r) for name in names for r in rows[name]]
            good = [(cell, r) for cell, r in own if r.get("family") == family]
            if not own:
                continue
            z = [
                (r["values"][k] - cell["values"][k]) / r["std"][k]
                for cell, r in good
                for k in cell["values"]
                if r["std"][k] and (r["built"] or not hidden)
            ]
            wrong = sum(r.get("built", False) and r["family"] != family for _, r in own)
            print(
                f"{family:5s} {'half hidden' if hidden else 'all round':11s} {len(own):4d} runs: family {len(good) / len(own):.3f}, built"
                f" {sum(r.get('built', False) for _, r in own) / len(own):.2f}, built as another {wrong}; 95 % intervals hold"
                f" {np.mean(np.abs(z) < 1.96) if z else np.nan:.2f} of {len(z)}, worst {np.abs(z).max() if z else np.nan:.1f}"
            )


if __name__ == "__main__":
    main()
