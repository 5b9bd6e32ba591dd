"""`python -m scan2fea.pipeline.faces_worker JOB.npz RESULT.npz`: the solid of true faces, or of NURBS patches, in a process of its own.

Open Cascade may take minutes over surfaces that nearly touch, and now and then crashes; it cannot be interrupted from inside.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from scan2fea.cad import WHOLE, CadOptions, Trued, drawn_solid, patched_solid, placed_drawing, true_solid
from scan2fea.io.artifacts import load, save
from scan2fea.kernel.processes import run_limited
from scan2fea.types import FloatArray, TriangleMesh


def true_solid_in_child(
    mesh: TriangleMesh,
    points: FloatArray,
    options: CadOptions,
    *,
    spacing_m: float,
    noise_m: float,
    resting: tuple[FloatArray, FloatArray] | None = None,
    way: str = WHOLE,
) -> Trued:
    """`true_solid` within `options.time_limit_s` of processor time; where it is stopped or dies the reason says so."""
    if not options.true_faces:
        return true_solid(mesh, points, options, spacing_m=spacing_m, noise_m=noise_m, resting=resting, way=way)
    more = {"spacing_m": spacing_m, "noise_m": noise_m, "resting": resting, "way": way}
    return _in_child({"mesh": mesh, "points": points, "options": options, "more": more}, options, "true faces")


def drawn_solid_in_child(mesh: TriangleMesh, options: CadOptions) -> Trued:
    """`drawn_solid`, as above."""
    return _in_child({"mesh": mesh, "drawn": True}, options, "faces as drawn")


def patched_solid_in_child(mesh: TriangleMesh, options: CadOptions, *, spacing_m: float, noise_m: float) -> Trued:
    """`patched_solid`, as above."""
    return _in_child({"mesh": mesh, "more": {"spacing_m": spacing_m, "noise_m": noise_m}}, options, "NURBS patches")


def drawing_in_child(path: Path, T_scene_drawing: FloatArray, options: CadOptions) -> Trued:
    """`placed_drawing`, as above."""
    return _in_child({"drawing": str(path), "T": T_scene_drawing}, options, "drawing")


def _in_child(task: dict[str, Any], options: CadOptions, what: str) -> Trued:
    with tempfile.TemporaryDirectory() as folder:
        job, result = Path(folder) / "job.npz", Path(folder) / "result.npz"
        save(task, job)
        command = [sys.executable, "-m", "scan2fea.pipeline.faces_worker", str(job), str(result)]
        try:
            ended = run_limited(command, options.time_limit_s)
        except subprocess.TimeoutExpired:
            return _none(f"the {what} took more than cad.time_limit_s = {options.time_limit_s:g} s")
        if not result.exists():
            last = ended.stderr.strip().splitlines()[-1:] or ["no message"]
            return _none(f"Open Cascade died over the {what} (code {ended.returncode}: {last[0]})")
        found = load(result)
    return found if isinstance(found, Trued) else _none(f"the result of the {what} could not be read")


def _none(reason: str) -> Trued:
    return Trued(brep=None, mesh=None, reason=reason, how={})


def main(job: Path, result: Path) -> None:
    """Do the job and save its result."""
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    task = load(job)
    if "points" in task:
        save(true_solid(task["mesh"], task["points"], task["options"], **task["more"]), result)
    elif "drawing" in task:
        save(placed_drawing(Path(task["drawing"]), task["T"]), result)
    elif "drawn" in task:
        save(drawn_solid(task["mesh"]), result)
    else:
        save(patched_solid(task["mesh"], **task["more"]), result)


def _end_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
