"""Runs worker.py in a process of its own, with limits on processor time and memory, and puts what went wrong in words."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import MeshingError
from scan2fea.kernel.processes import run_limited

KILLED = 9  # SIGKILL

# what gmsh says -> what the user can do; the first that fits
_REASONS = (
    ("overlapping facets", "two parts of the surface lie on one another", "repair the surface, or remesh it finer where walls are thin"),
    ("intersect", "the surface crosses itself or folds back on itself", "repair the surface"),
    ("Invalid boundary mesh", "the surface does not bound a volume (crossing or overlapping triangles)", "repair the surface"),
    ("HXT 3D mesh failed", "the mesher could not fill the surface", "repair the surface: it touches or folds back on itself somewhere"),
    ("recover", "the mesher could not keep all triangles of the surface", "remesh it: long thin triangles are the usual cause"),
    ("No elements in volume", "the surface encloses nothing", "repair the surface"),
    ("bad_alloc", "the mesher ran out of its memory", "raise tetmeshing.memory_limit_gib or mesh coarser"),
    ("unable to allocate", "the mesher ran out of its memory", "raise tetmeshing.memory_limit_gib or mesh coarser"),
)


def run_worker(job: dict[str, Any], *, time_limit_s: float, memory_limit_gib: float) -> dict[str, Any]:
    """The result of the job (see worker.py). Raises MeshingError with gmsh's reason, or that it crashed or was stopped."""
    with tempfile.TemporaryDirectory() as folder:
        job_path, result_path = Path(folder) / "job.npz", Path(folder) / "result.npz"
        np.savez(job_path, **{**job, "memory_gib": memory_limit_gib})
        command = [sys.executable, "-P", str(Path(__file__).with_name("worker.py")), str(job_path), str(result_path)]
        try:
            ended = run_limited(command, time_limit_s, folder=Path(folder))
        except subprocess.TimeoutExpired:
            raise MeshingError(
                f"the mesher was stopped after {time_limit_s:.0f} s of processor time: mesh coarser (remesh.edge_m, tetmeshing.edge_m)"
                " or raise tetmeshing.time_limit_s"
            ) from None
        if not result_path.exists():
            raise MeshingError(_crash(ended.returncode, ended.stderr, memory_limit_gib))
        with np.load(result_path) as archive:
            result = {name: archive[name] for name in archive.files}
    if str(result["error"]):
        raise MeshingError(in_words(str(result["error"])))
    return result


def in_words(reason: str) -> str:
    """gmsh's own line, and before it what it means and what to do where that is known."""
    for part, meaning, action in _REASONS:
        if part.lower() in reason.lower():
            return f"{meaning}: {action} (gmsh: {reason})"
    return f"gmsh could not fill the surface: {reason}"


def _crash(code: int, stderr: str, memory_limit_gib: float) -> str:
    if "MemoryError" in stderr or "bad_alloc" in stderr:
        return f"the mesher ran out of its {memory_limit_gib:g} GiB: raise tetmeshing.memory_limit_gib or mesh coarser"
    if code == -KILLED:
        return "the mesher was killed from outside: most often the system ran out of memory; lower run.jobs or mesh coarser"
    how = f"signal {-code}" if code < 0 else f"exit code {code}"
    last = stderr.strip().splitlines()[-1] if stderr.strip() else "no message"
    return f"the mesher crashed ({how}; {last}): the surface is one it cannot handle; repair or remesh it"
