"""`python -m scan2fea.pipeline.faces_worker JOB.npz RESULT.npz`: the solid of true faces in a process of its own.

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

from scan2fea.cad import CadOptions, Trued, true_solid
from scan2fea.io.artifacts import load, save
from scan2fea.types import FloatArray, TriangleMesh


def true_solid_in_child(
    mesh: TriangleMesh,
    points: FloatArray,
    options: CadOptions,
    *,
    spacing_m: float,
    noise_m: float,
    resting: tuple[FloatArray, FloatArray] | None = None,
) -> Trued:
    """`true_solid` within `options.time_limit_s` of wall clock; where it is stopped or dies the reason says so."""
    if not options.true_faces:
        return true_solid(mesh, points, options, spacing_m=spacing_m, noise_m=noise_m, resting=resting)
    with tempfile.TemporaryDirectory() as folder:
        job, result = Path(folder) / "job.npz", Path(folder) / "result.npz"
        more = {"spacing_m": spacing_m, "noise_m": noise_m, "resting": resting}
        save({"mesh": mesh, "points": points, "options": options, "more": more}, job)
        command = [sys.executable, "-m", "scan2fea.pipeline.faces_worker", str(job), str(result)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        try:
            ended = subprocess.run(command, capture_output=True, timeout=options.time_limit_s, env=environment, check=False)
        except subprocess.TimeoutExpired:
            return Trued(brep=None, mesh=None, reason=f"the true faces took more than cad.time_limit_s = {options.time_limit_s:g} s", how={})
        if not result.exists():
            last = ended.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
            return Trued(brep=None, mesh=None, reason=f"Open Cascade died over the true faces (code {ended.returncode}: {last[0]})", how={})
        found = load(result)
    if not isinstance(found, Trued):
        return Trued(brep=None, mesh=None, reason="the result of the true faces could not be read", how={})
    return found


def main(job: Path, result: Path) -> None:
    """Do the job and save its result."""
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    task = load(job)
    save(true_solid(task["mesh"], task["points"], task["options"], **task["more"]), result)


def _end_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
