"""`scan2fea reconstruct`: the points of one file as one closed surface. Exit 0 where it passes every check, 4 where it does not."""

from __future__ import annotations

import argparse
from pathlib import Path

from scan2fea.cli.settings import config_of
from scan2fea.pipeline.reconstruct import reconstruct_file
from scan2fea.units import MILLIMETRES_PER_METRE

NOT_PASSED = 4


def execute(given: argparse.Namespace) -> int:
    out = Path(given.out)
    report = reconstruct_file(Path(given.file), out, config_of(given))
    surface, how = report["surface"], report["how"]
    share = surface["area_share"]
    mm = MILLIMETRES_PER_METRE
    print(f"{given.file}: {report['n_points']:,} points, unit {report['unit']} ({report['unit_source']}), sensor position {report['sensor']}")
    print(f"  method        {how['method']}, outside told by {how['source']}")
    print(f"  spacing       {mm * how['spacing_m']:.3g} mm, noise {mm * how['sigma_m']:.3g} mm")
    state = "closed" if surface["closed"] and surface["manifold"] else "NOT closed and manifold"
    print(f"  surface       {surface['n_faces']:,} faces, {state}, {surface['n_self_intersections']} crossings, {1e3 * surface['volume_m3']:.6g} L")
    print(f"  area          {share['measured']:.1%} measured, {share['interpolated']:.1%} interpolated, {share['invented']:.1%} invented")
    if "not_planar" in how:
        print(f"  not flat      {how['not_planar']}")
    print(f"  {'passed every check' if report['passed'] else 'REFUSED: ' + report['reason']}")
    print(out / "surface.ply")
    if (out / "sheet.ply").exists():
        print(f"{out / 'sheet.ply'} (what was measured)")
    return 0 if report["passed"] else NOT_PASSED
