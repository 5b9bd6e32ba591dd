"""Members under noise along rays that nobody tells: how far off dimensions are, over what is told of it.

    python benchmarks/estimation_ray_noise.py [--seed 100] [--draws 24]

Sections of six families, sizes 0.7 to 1.5 of the usual, 1.6 m long, from three to eight stations all round, 6,000 or 20,000 hits, 0.3, 1 and 2 mm of
noise along each ray. The fit sees the points alone. Told dimensions of the right family, with the doubt of `face_noise` and without it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "estimation"))
import scans

from scan2fea.errors import Scan2FeaError
from scan2fea.estimation import member as route
from scan2fea.types import Member, PointCloud, Scan

SHAPES = (
    ("L", {"a": 0.15, "b": 0.1, "t": 0.012}),
    ("I", {"h": 0.2, "b": 0.1, "tw": 0.008, "tf": 0.012}),
    ("T", {"h": 0.1, "b": 0.1, "tw": 0.011, "tf": 0.011}),
    ("C", {"h": 0.16, "b": 0.065, "tw": 0.0085, "tf": 0.0105}),
    ("rect", {"b": 0.12, "t": 0.02}),
    ("RHS", {"h": 0.15, "b": 0.1, "t": 0.008}),
)
NOISE = (0.0003, 0.001, 0.002)
LENGTH = 1.6


def drawn(seed: int) -> tuple[str, dict[str, float], float, Scan]:
    """Family, dimensions, noise and scan of a draw; its rays are known and are not given to the fit."""
    rng = np.random.default_rng([seed, 4242])
    family, usual = SHAPES[seed % len(SHAPES)]
    values = {name: size * float(rng.uniform(0.7, 1.5)) for name, size in usual.items()}
    for long, short in {"L": (("a", "b"),), "RHS": (("h", "b"),)}.get(family, ()):
        values[long], values[short] = max(values[long], values[short]), min(values[long], values[short])
    noise, n = NOISE[seed // len(SHAPES) % len(NOISE)], int(rng.choice([6_000, 20_000]))
    solid = scans.member(family, values, LENGTH, scans.pose(seed))
    scan = scans.all_round(solid, n, scans.Sensor(sigma_m=noise), seed, n_stations=int(rng.integers(3, 9)))
    return family, {**values, "length": LENGTH}, noise, scan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--draws", type=int, default=24)
    given = parser.parse_args()
    before: list[Member] = []
    doubted = route.doubted_for_rays

    def noted(points: np.ndarray, member: Member, face_weight: np.ndarray | None, seed: int) -> Member:
        before.append(member)
        return doubted(points, member, face_weight, seed)

    route.doubted_for_rays = noted
    rows = []
    for seed in range(given.seed, given.seed + given.draws):
        family, true, noise, scan = drawn(seed)
        before.clear()
        try:
            found = route.fit_member(Scan(cloud=PointCloud.of(scan.cloud.points)))
        except Scan2FeaError as error:
            print(f"{seed} {family}: {error}")
            continue
        if found.member.family != family or not before:
            print(f"{seed} {family}: taken for {found.member.family}, explained {found.explains}")
            continue
        plain = {p.name: p.std_m for p in before[-1].parameters}
        for p in found.member.parameters:
            if p.observable and p.std_m and plain[p.name]:
                error = p.value_m - true[p.name]
                rows.append((p.name == "length", error / p.std_m, error / plain[p.name], error / noise))
                print(f"{seed} {family} {1e3 * noise:g} mm {p.name}: {1e3 * error:+.3f} +- {1e3 * p.std_m:.3f} (was {1e3 * plain[p.name]:.3f}) mm")
    for what, own in (("dimensions", [r[1:] for r in rows if not r[0]]), ("lengths", [r[1:] for r in rows if r[0]])):
        z = np.abs(np.array(own))
        hold, rms, worst = (z < 1.96).mean(axis=0), np.sqrt((z**2).mean(axis=0)), z.max(axis=0)
        print(
            f"{len(z)} {what}: 95 % intervals hold {hold[0]:.3f} (without the doubt {hold[1]:.3f}), error over deviation {rms[0]:.2f} rms"
            f" ({rms[1]:.2f}), worst {worst[0]:.1f} ({worst[1]:.1f}); worst error {worst[2]:.2f} of the noise"
        )


if __name__ == "__main__":
    main()
