"""How well rays tell a thin angle that the points cannot: 127 x 127 x 6.35 mm, 3.048 m, noise of 20 mm along the ray.

    python benchmarks/estimation_rays.py [--seeds 20] [--cells all,inner,...] [--jobs N] [--seconds S] [--state FILE] [--speed] [--bound]

Every cell prints, over its seeds: the share of fits within the target, RMSE, the mean reported standard deviation and the cover of 95 % intervals,
for dimensions that the fit says it can tell, and how often it does.

--bound: the same legs at the Cramer-Rao bound of the very rays: Fisher's information at the truth, expected over a few noises on each seed's rays,
with all unknowns free, and with some of them known. No unbiased fit can have more legs within the limit.
"""

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import numpy as np
from scipy.special import ndtr

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "estimation"))
import scans
from in_parallel import ordered, read_state, run_all

from scan2fea.errors import Scan2FeaError
from scan2fea.estimation.catalogue import outer_sizes
from scan2fea.estimation.catalogued import catalogued
from scan2fea.estimation.ray_data import prepared
from scan2fea.estimation.ray_likelihood import RayOptions, fit_rays
from scan2fea.estimation.ray_model import WALL_PRIOR, RayLayout, RayModel
from scan2fea.estimation.ray_starts import of_member
from scan2fea.kernel.transforms import compose, rigid, rotation_about
from scan2fea.types import Scan

LENGTH = 3.048
BEAM = 0.003  # rad, full opening
CELLS = {  # name: (kind, share of frames, sensor, is the footprint stated)
    "all round, normal noise": ("round", 1.0, {"footprint_rad": BEAM}, True),
    "all round, uniform noise": ("round", 1.0, {"footprint_rad": BEAM, "noise": "uniform"}, True),
    "all round, no footprint": ("round", 1.0, {}, True),
    "all round, footprint not stated": ("round", 1.0, {"footprint_rad": BEAM}, False),
    "all round, footprint stated half": ("round", 0.5, {"footprint_rad": BEAM}, True),
    "all round, half of the beam must hit": ("round", 1.0, {"footprint_rad": BEAM, "returns": "half"}, True),
    "all round, any of the beam may hit": ("round", 1.0, {"footprint_rad": BEAM, "returns": "any"}, True),
    "all round, hits alone": ("hits", 1.0, {"footprint_rad": BEAM}, True),
    "HDL-32E inner side": ("inner", 1.0, {"footprint_rad": BEAM}, True),
    "HDL-32E inner side, 20 % of the frames": ("inner", 0.2, {"footprint_rad": BEAM}, True),
    "HDL-32E outer side": ("outer", 1.0, {"footprint_rad": BEAM}, True),
    "HDL-32E outer side, 20 % of the frames": ("outer", 0.2, {"footprint_rad": BEAM}, True),
    "HDL-32E inner side, no footprint": ("inner", 1.0, {}, True),
    "HDL-32E outer side, no footprint": ("outer", 1.0, {}, True),
    "HDL-32E inner side, uniform noise": ("inner", 1.0, {"footprint_rad": BEAM, "noise": "uniform"}, True),
}


def start_of(solid, seed):
    """The axis a few mm and 0.2 degrees off, any roll, the section 30 % off: what a fit to the points would give, or worse."""
    rng = np.random.default_rng([seed, 10])
    off = rigid(rotation_about((*rng.standard_normal(2), 0), 0.003), rng.uniform(-0.02, 0.02, 3))
    away = compose(solid.T_world_member, off, rigid(rotation_about((0, 0, 1), rng.uniform(0, 6.28)), (0, 0, 0)))
    return scans.member("L", {"a": 0.09, "b": 0.15, "t": 0.02}, LENGTH - 0.018, away)


def scan_of(kind, share, sensor, seed, n_hits=20_000):
    """Ring scans look at the angle's inside or outside within 29 degrees of its diagonal; stations all round see any roll."""
    rng = np.random.default_rng([seed, 9])
    ring = kind in ("inner", "outer")
    solid = scans.member("L", scans.THIN_L, LENGTH, scans.pose(seed, np.pi / 4 + rng.uniform(-0.5, 0.5) if ring else None))
    if ring:
        return solid, scans.ring_scan(solid, 1 if kind == "inner" else -1, sensor, seed, share=share)
    scan = scans.all_round(solid, n_hits, sensor, seed)
    return solid, scan.compact() if kind == "hits" else scan


def run(what):
    """One line of the state file: errors and reported standard deviations (None: not observable), metres."""
    name, seed = what
    kind, share, sensor, stated = CELLS[name]
    solid, scan = scan_of(kind, share, scans.Sensor(**sensor), seed)
    if not stated:
        scan = Scan(cloud=scan.cloud, rays=dataclasses.replace(scan.rays, footprint_rad=None))
    options = RayOptions(footprint_rad=0.5 * BEAM) if name.endswith("stated half") else RayOptions()
    begin = time.process_time()
    try:
        fit = fit_rays(scan, start_of(solid, seed), options)
    except Scan2FeaError as error:
        return {"cell": name, "seed": seed, "error": str(error), "seconds": time.process_time() - begin}
    row = {"cell": name, "seed": seed, "seconds": time.process_time() - begin, "hits": fit.n_hits, "misses": fit.n_misses}
    told = {one.name: (one.value_m - solid.values()[one.name], one.std_m if one.observable else None) for one in fit.member.parameters}
    try:
        sizes = outer_sizes(catalogued(fit.member).catalogue)
    except Scan2FeaError:  # no leg was told: the table says nothing
        sizes = ()
    off = max((abs(sizes[0][0][name] - solid.values()[name]) for name in "ab"), default=None) if sizes else None
    return {**row, **told, "table": (off, sizes[0][1] if sizes else 0.0)}


def table(name, rows):
    good = [row for row in rows if "error" not in row]
    print(f"{name}: {len(rows)} seeds, {len(rows) - len(good)} failed, {np.median([r['seconds'] for r in rows]):.2f} s of CPU", flush=True)
    if not good:
        return
    of = {d: np.array([row[d] for row in good], float) * 1e3 for d in ("a", "b", "t", "length")}
    report("legs", np.concatenate([of["a"], of["b"]]), 3.0 if CELLS[name][0] in ("inner", "outer") else 1.5)
    known = np.array([row["table"] for row in good if "table" in row], float).reshape(-1, 2)  # nan: the table says nothing
    if len(known):
        limit, sure = (0.003 if CELLS[name][0] in ("inner", "outer") else 0.0015), known[known[:, 1] > 0.5]
        right = np.mean(known[:, 0] < limit)
        of_sure = f", of {len(sure)} with a probability over 0.5 {np.mean(sure[:, 0] < limit):.0%}" if len(sure) else ""
        print(f"    likeliest outer size of the catalogue: both legs within {limit * 1e3} mm in {right:.1%} of {len(known)}{of_sure}", flush=True)
    report("t", of["t"], 2.0)
    report("length", of["length"], 5.0)


def report(name, rows, limit):
    told = np.isfinite(rows[:, 1])
    error, sd = rows[told, 0], rows[told, 1]
    line = f"    {name:7s} told {told.mean():4.0%}"
    if told.any():
        cover = np.mean(np.abs(error) < 1.96 * sd)
        within = np.mean(np.abs(error) < limit)
        line += f", of these within {limit} mm {within:4.0%}, bias {error.mean():+.2f}, rmse {np.sqrt(np.mean(error**2)):.2f}, "
        line += f"sd reported {np.sqrt(np.mean(sd**2)):.2f} mm, 95 % interval covers {cover:.2f}"
    print(line + f"; all within {limit} mm {np.mean(np.abs(rows[:, 0]) < limit):4.0%}", flush=True)


KNOWN = {  # what would be given away -> names of the unknowns
    "nothing known": (),
    "the wall known": ("t",),
    "wall, roll, direction, ends and noise known": ("t", "roll", "x1", "y1", "start", "end", "log_sigma"),
}
FREE_OF = ("edge", "log_footprint", "logit_dropped", "logit_outlier")  # known all the same: the sensor is stated and every ray is sound
N_NOISES = 5


def bounds_of(name, seed):
    """What is known -> standard deviations (2,) of the legs at the bound, metres."""
    kind, share, sensor, _ = CELLS[name]
    solid, scan = scan_of(kind, share, scans.Sensor(**sensor), seed)
    layout, box = RayLayout("L", 1), np.array([[-0.5, -0.5], [1.5, 1.5]]) * max(scans.THIN_L.values())
    near = prepared(scan, solid, 1, None, box).rows
    total = np.zeros((len(layout.names),) * 2)
    for k in range(N_NOISES):
        rng = np.random.default_rng([seed, 55, k])
        data = prepared(scans.shoot(solid, scan.rays.origin[near], scan.rays.direction[near], scans.Sensor(**sensor), rng), solid, 1, None, box)
        theta = of_member(data, layout, dataclasses.replace(solid, sigma_m=scans.Sensor(**sensor).sigma_m))
        theta[-2:] = -7.0  # all but no ray is lost or means nothing
        scores = RayModel(layout, data).evaluate(theta)[1]
        total += scores.T @ scores / N_NOISES
    at = layout.place["t"]
    total[at, at] += 1 / (WALL_PRIOR[1] * max(scans.THIN_L.values())) ** 2
    found = {}
    for what, known in KNOWN.items():
        free = [n for n in layout.names if n not in known and n not in FREE_OF]
        part = total[np.ix_([layout.place[n] for n in free], [layout.place[n] for n in free])]
        unit = 1 / np.sqrt(np.diag(part))
        covariance = np.linalg.pinv(part * np.outer(unit, unit), rcond=1e-13) * np.outer(unit, unit)
        found[what] = np.sqrt(np.abs([covariance[free.index(n), free.index(n)] for n in "ab"]))
    return found


def bound_table(name, rows):
    """The legs that the fit tells, at the bound and as they came out."""
    limit = 0.003 if CELLS[name][0] in ("inner", "outer") else 0.0015
    good = [row for row in rows if "error" not in row]
    at = [bounds_of(name, row["seed"]) for row in good]
    told = np.array([[row[d][1] is not None for d in "ab"] for row in good])
    error = np.array([[row[d][0] for d in "ab"] for row in good])[told]
    sd = np.array([[row[d][1] for d in "ab"] for row in good], float)[told]
    within = {what: ndtr(limit / np.array([one[what] for one in at])) * 2 - 1 for what in KNOWN}
    least = np.array([one["nothing known"] for one in at])[told]
    print(f"    {told.sum()} told legs within the limit as fitted {np.mean(np.abs(error) < limit):.1%}; at the bound (all legs in brackets)")
    for what, share in within.items():
        print(f"        {share[told].mean():.1%} ({share.mean():.1%}) {what}")
    print(f"    bound {1e3 * np.median(least):.2f} mm in the median, {1e3 * np.quantile(least, 0.9):.2f} in a tenth", end="")
    print(f"; reported over bound {np.median(sd / least):.2f}, error over reported {np.sqrt(np.mean((error / sd) ** 2)):.2f} rms", flush=True)


def speed():
    sensor = scans.Sensor(footprint_rad=BEAM)
    for n in (20_000, 200_000, 1_400_000):
        solid, scan = scan_of("round", 1.0, sensor, 0, n)
        fit_rays(scan, start_of(solid, 0), RayOptions(n_start=200, n_fit=500, n_polish=500))  # compile
        begin, wall = time.process_time(), time.time()
        fit = fit_rays(scan, start_of(solid, 0))
        print(f"{len(scan.rays)} rays ({fit.n_hits} hits): {time.process_time() - begin:.2f} s of CPU, {time.time() - wall:.2f} s", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="of each cell; 0: only the table of what is there")
    parser.add_argument("--cells", default="", help="parts of the names of the cells, with commas between")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="wall time after which no further run begins")
    parser.add_argument("--state", type=Path, default=Path("estimation_rays.jsonl"))
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--bound", action="store_true")
    chosen = parser.parse_args()
    if chosen.speed:
        speed()
    else:
        names = [name for name in CELLS if any(part in name for part in chosen.cells.split(","))]
        todo = ordered(dict.fromkeys(names, chosen.seeds), lambda name: CELLS[name][0] not in ("inner", "outer"), read_state(chosen.state))
        run_all(todo, run, chosen.state, jobs=chosen.jobs, seconds=chosen.seconds)
        found = read_state(chosen.state)
        for name in names:
            if found[name]:
                table(name, found[name])
            if found[name] and chosen.bound:
                bound_table(name, found[name])
