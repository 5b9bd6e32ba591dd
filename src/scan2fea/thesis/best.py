"""The same clouds by this program's own way: the whole pipeline, told only which object is meant."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import StageError
from scan2fea.io.scan_writers import write_ply
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.pipeline.config import Config, load_config
from scan2fea.pipeline.run import run
from scan2fea.report.ours import read_surface
from scan2fea.simulation.motion import path_of
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.clouds import BEAM, HDL, SIGMA_M, capture, hdl_scans, hdl_sensor, lab, lab_scan
from scan2fea.thesis.published import stated
from scan2fea.types import Scan, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

CROP_M = 0.1  # round the beam, in a quick run
# of each case: what is asked of the noise
CASES: Mapping[str, str] = {
    "zero": "zero noise",
    "noise": "2 cm as three standard deviations, in x, y and z, stated",
    "blind": "2 cm as three standard deviations, not stated",
    "uniform": "evenly within 2 cm, in x, y and z, stated",
    "sigma": "2 cm as one standard deviation, in x, y and z, stated",
    "known": "2 cm as three standard deviations, the section known",
    "hdl_known": "HDL-32E, one sweep in five, poses known, the section known",
    "hdl": "HDL-32E, one sweep in five, poses known",
    "hdl_all_known": "HDL-32E, every sweep, poses known, the section known",
    "hdl_all": "HDL-32E, every sweep, poses known",
    "hdl_unposed": "HDL-32E, one sweep in five, joined without poses, the section known",
}
# of each cloud of the thesis: the cases that stand as "best route" in its tables
OF_CLOUD: Mapping[str, tuple[str, ...]] = {
    "zero": ("zero",), "noise": ("noise", "blind"), "hdl": ("hdl_known", "hdl", "hdl_all_known", "hdl_all", "hdl_unposed"),
}  # fmt: skip
# what the pipeline is told beyond the scan
GIVEN: Mapping[str, str] = {
    "zero": "nothing", "noise": "law and size of the noise, as 3.3.2 states them; nothing of the section", "blind": "nothing",
    "uniform": "law and size of the noise; nothing of the section", "sigma": "law and size of the noise; nothing of the section",
    "known": "the section, as 3.3.9 assumes it", "hdl_known": "poses, and the section, as 3.3.9 assumes it", "hdl": "poses",
    "hdl_all_known": "poses, and the section, as 3.3.9 assumes it", "hdl_all": "poses", "hdl_unposed": "the section, as 3.3.9 assumes it; no pose",
}  # fmt: skip
KNOWN = ("known", "hdl_known", "hdl_all_known", "hdl_unposed")
UNPOSED = "hdl_unposed"
# law and standard deviation of the noise (m) where the pipeline is told them
STATED: Mapping[str, tuple[str, float]] = {
    "noise": ("gaussian", SIGMA_M), "sigma": ("gaussian", stated("noise_m")), "uniform": ("uniform", stated("noise_m") / 3**0.5),
}  # fmt: skip


def shown(case: str, *, quick: bool) -> tuple[str, ...]:
    """The cases of a cloud; a quick run shows the first alone."""
    return OF_CLOUD[case][:1] if quick else OF_CLOUD[case]


@dataclass(frozen=True, eq=False, kw_only=True)
class Best(Value):
    """What `run` made of the beam: its row of report.json and its surface. row : {} where the object was not found."""

    case: str
    row: Mapping[str, Any]
    surface: TriangleMesh | None
    n_points: int

    @property
    def converted(self) -> bool:
        return self.row.get("verdict") == "converted"

    @property
    def reason(self) -> str:
        return str(self.row.get("reason") or "the beam was not found")

    @property
    def volume_m3(self) -> float | None:
        volume = (self.row.get("surface") or {}).get("volume_m3")
        return None if volume is None else float(volume)

    def parameters(self) -> dict[str, tuple[float, float | None, bool]]:
        """Dimension -> (metres, standard deviation or None, whether the data tell it)."""
        member = self.row.get("member") or {}
        return {name: (p["value_m"], p.get("std_m"), bool(p["observable"])) for name, p in (member.get("parameters") or {}).items()}

    def case_value(self, name: str, measure: str) -> tuple[float, float | None] | None:
        """Value and standard deviation of a figure of the finite element model; None where it has none."""
        for case in (self.row.get("fea") or {}).get("cases") or []:
            if (case["name"], case["measure"]) == (name, measure) and case["value"] is not None:
                return float(case["value"]), case.get("std")
        return None


def best(bench: Bench, case: str) -> Best:
    """The beam of a case (a key of CASES) by `run`, from the files of the whole scene. Raises StageError where no object comes out."""
    return bench.kept(f"best {case}", lambda: _best(bench, case))


def _best(bench: Bench, case: str) -> Best:
    scans = scans_of(bench, case)
    folder = bench.folder / "runs" / case
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "scans").mkdir(parents=True)
    report = run(_files(bench, case, scans, folder / "scans"), folder / "out", config_of(bench, case))
    if not report["objects"]:
        raise StageError("the pipeline found no object where the beam is")
    row = report["objects"][0]
    surface = _surface(folder / "out" / "objects" / f"{int(row['id']):02d}", row)
    shutil.rmtree(folder / "scans")
    return Best(case=case, row=_plain(row), surface=surface, n_points=sum(len(s.cloud) for s in scans))


def _files(bench: Bench, case: str, scans: tuple[Scan, ...], folder: Path) -> list[Path]:
    if case == UNPOSED:
        return [capture(bench, every_of(case), folder)]
    files = []
    for k, scan in enumerate(scans):
        files.append(folder / f"{k:03d}.ply")
        write_ply(files[-1], Scan(cloud=dataclasses.replace(scan.cloud, label=None), rays=scan.rays))
    return files


def every_of(case: str) -> int:
    """Of a case of the HDL-32E: one sweep in so many."""
    return 1 if case.startswith("hdl_all") else 5


def scans_of(bench: Bench, case: str) -> tuple[Scan, ...]:
    """What the pipeline is given.

    Noisy points lie evenly at random: the lab's grid puts one row of points on a toe of 6.35 mm, 1.6 times its share of a pitch of 10.16 mm, which
    noise hides, so that a fit that takes points to be spread evenly makes the legs too long.
    """
    if case.startswith("hdl"):
        return hdl_scans(bench, every_of(case))
    if case == "zero":
        return (lab_scan(bench),)
    noise = SIGMA_M if case in ("noise", "blind", "known") else stated("noise_m")
    return (lab_scan(bench, noise, "uniform" if case == "uniform" else "gaussian", method="uniform"),)


def config_of(bench: Bench, case: str) -> Config:
    """The defaults; of the scene's objects only the one nearest to the middle of the beam's heel is converted.

    STATED: the law and size of the noise are given, as 3.3.2 gives them; walls thinner than the noise are told by nothing else.
    "known", "hdl_known": the section is given, as informed shape estimation assumes (3.3.9). A quick run crops the scene to a box round the beam
    first: the other objects are then not cut out of it.
    """
    beam = lab(bench.options.seed).solids[BEAM]
    middle = applied(beam.T_world_shape, np.array([[0.0, 0.0, beam.shape.parameters["length"] / 2]]))
    settings: dict[str, Any] = {"run.seed": bench.options.seed, "run.jobs": 1}
    if case == UNPOSED:  # all is told in the frame of the scanner, as it stood at first
        settings["registration.sweeps"] = "odometry"
        sensor = hdl_sensor(bench, every_of(case)).sensors[0].options
        middle = applied(inverse(path_of(sensor, HDL).T_world_sensor[0]), middle)
    settings["select.near_m"] = tuple(round(float(x), 4) for x in middle[0])
    if case in STATED:
        law, sigma = STATED[case]
        settings |= {"estimation.noise": law, "estimation.sigma_m": sigma, "estimation.sigma_error": 0.0}
    if case in KNOWN:
        sizes = (beam.shape.parameters[name] for name in ("a", "b", "t"))
        settings["route.member"] = "L" + "x".join(f"{MILLIMETRES_PER_METRE * size:g}" for size in sizes)
    if bench.options.quick and case != UNPOSED:
        low, high = beam.mesh.vertices.min(axis=0) - CROP_M, beam.mesh.vertices.max(axis=0) + CROP_M
        settings["filtering.crop_box_m"] = tuple(round(float(x), 4) for x in (*low, *high))
    return load_config(None, settings)


def _surface(folder: Path, row: Mapping[str, Any]) -> TriangleMesh | None:
    return read_surface(folder / "surface.ply") if "surface.ply" in (row.get("files") or []) else None


def _plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """The row without what no experiment reads and what changes from run to run."""
    kept = ("verdict", "reason", "route", "route_reason", "n_points", "surface", "volume", "member", "fea", "checks", "kind")
    return {key: row[key] for key in kept if key in row}
