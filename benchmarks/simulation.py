"""How long scenes take: the lab's 114,808 points, every kind of object, sampling, and what one terrestrial station costs.

    python benchmarks/simulation.py

Prints processor seconds. Target: the lab at 114,808 points in 2 s (scene, checks, points and files; STEP files apart).
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def timed(name: str, work: Callable[[], Any]) -> Any:
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    print(f"{name:44s} {time.perf_counter() - wall:8.2f} s wall {time.process_time() - cpu:8.2f} s cpu", flush=True)
    return result


def main() -> None:
    simulate = timed("import", lambda: __import__("scan2fea.pipeline.simulate", fromlist=["x"]))
    from scan2fea.report.scene_picture import scene_picture
    from scan2fea.simulation.lab17 import lab17
    from scan2fea.simulation.sampling import SamplingOptions, sampled
    from scan2fea.simulation.scene_checks import check_scene

    given = timed("lab: solids (first call compiles)", lambda: simulate.scene_named("lab", 0))
    timed("lab: overlap check", lambda: check_scene(given.scene))
    timed("lab: grid (first call compiles)", lambda: sampled(given.scene, given.sampling, 0))
    scan = timed("lab: grid, 114,808 points", lambda: sampled(lab17(0), given.sampling, 0))
    assert len(scan.cloud) == 114_808
    timed("lab: uniform", lambda: sampled(given.scene, SamplingOptions(), 0))
    timed("lab: blue noise", lambda: sampled(given.scene, SamplingOptions(method="blue_noise"), 0))
    timed("lab: picture", lambda: scene_picture([s.mesh for s in given.scene.solids], [scan]))
    with tempfile.TemporaryDirectory() as folder:
        timed("lab: all files but STEP", lambda: simulate.simulate_scene(given, Path(folder) / "a", step=False))
        timed("lab: all files and STEP", lambda: simulate.simulate_scene(given, Path(folder) / "b"))
        timed("lab: hdl32e, 20 turns", lambda: simulate.simulate_scene(simulate.with_sensor(given, "hdl32e"), Path(folder) / "c", step=False))
        timed(
            "lab: terrestrial, 4 stations at 0.25 deg",
            lambda: simulate.simulate_scene(simulate.with_sensor(given, "terrestrial"), Path(folder) / "d", step=False),
        )


if __name__ == "__main__":
    main()
