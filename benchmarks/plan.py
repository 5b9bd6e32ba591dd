"""Does a plan come true? Its bounds against the scatter of fits to simulated scans of the same scene, member by member.

    python benchmarks/plan.py [--fits 50] [--members L,I,C,rect,T] [--first-seed 0]

Prints, per member and dimension: planned standard deviation, scatter of the fits, their ratio (50 fits know a scatter to 10 %), and the mean error.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from scan2fea.estimation import FitOptions, fit_section
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.pipeline.plan import plan_scene
from scan2fea.simulation.scene_file import scene_of
from scan2fea.simulation.sensors import SENSORS

RING = [[round(2.5 * math.cos(a), 3), round(2.5 * math.sin(a), 3), z] for a, z in zip(np.arange(8) * np.pi / 4, [0.2, 1.4] * 4, strict=True)]
MEMBERS = {
    "L": 'a = "127 mm"\nb = "100 mm"\nt = "12 mm"',
    "I": 'h = "200 mm"\nb = "100 mm"\ntw = "8 mm"\ntf = "12 mm"',
    "C": 'h = "140 mm"\nb = "60 mm"\ntw = "8 mm"\ntf = "11 mm"',
    "rect": 'b = "100 mm"\nt = "30 mm"',
    "T": 'h = "120 mm"\nb = "150 mm"\ntw = "10 mm"\ntf = "14 mm"',
}
SCENE = """
[[object]]
name = "member"
kind = "{family}"
{sizes}
length = "1.2 m"
spacing = "12 mm"
[[sensor]]
kind = "stations"
positions_m = {ring}
noise_m = "1.5 mm"
"""


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--fits", type=int, default=50)
    given.add_argument("--members", default=",".join(MEMBERS))
    given.add_argument("--first-seed", type=int, default=0)
    chosen = given.parse_args()
    n = chosen.fits
    for family in chosen.members.split(","):
        sizes = MEMBERS[family]
        scene = scene_of(SCENE.format(family=family, sizes=sizes, ring=RING))
        solid, sensor = scene.scene.solids[0], scene.sensors[0]
        planned = {d.name: d for d in plan_scene(scene).objects[0].dimensions}
        fits = []
        for seed in range(chosen.first_seed, chosen.first_seed + n):
            scans = SENSORS[sensor.kind].scan(scene.scene, sensor.options, seed)
            points = np.concatenate([scan.cloud.points for scan in scans])
            fit = fit_section(applied(inverse(solid.T_world_shape), points), FitOptions(families=(family,), seed=seed))
            told = dict(zip(fit.names, fit.values.tolist(), strict=True)) if fit.family == family else {}
            fits.append([told.get(name, np.nan) for name in PARAMETERS[family]])
        table = np.array(fits)
        for k, name in enumerate(PARAMETERS[family]):
            error = table[:, k] - solid.shape.parameters[name]
            scatter, bound = float(np.nanstd(error, ddof=1)), planned[name].std_m or np.nan
            print(
                f"{family:5s} {name:3s} {len(points):6d} points  planned {bound * 1e3:7.4f} mm  scatter {scatter * 1e3:7.4f} mm  "
                f"ratio {scatter / bound:5.2f}  mean error {np.nanmean(error) * 1e3:8.4f} mm",
                flush=True,
            )


if __name__ == "__main__":
    main()
