"""Peaks of stress at a hole against the closed form, by the number of element edges round it.

    python benchmarks/holes.py [RADIUS_MM THICKNESS_MM]

Plates 200 x 100 mm with a hole in the middle, pulled at both ends by 1 MPa: drawn, made true faces, meshed and solved as `run` does.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import gmsh
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from drawn import drawing, triangles
from scan2fea.cad import drawn_solid
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.tetmeshing import FillOptions, fill

WIDTH_MM = 100.0


def closed_form(radius_mm: float) -> float:
    """Stress at the hole over that far away, finite width (Heywood 1952, after Howland 1930; Pilkey 1997, chart 4.1)."""
    rest = 1 - 2 * radius_mm / WIDTH_MM
    return (2 + 0.284 * rest - 0.600 * rest**2 + 1.32 * rest**3) / rest


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("radius_mm", type=float, nargs="?", default=10.0)
    ask.add_argument("thickness_mm", type=float, nargs="?", default=6.0)
    given = ask.parse_args()
    with drawing() as occ:
        plate = occ.addBox(-100, -WIDTH_MM / 2, 0, 200, WIDTH_MM, given.thickness_mm)
        hole = occ.addCylinder(0, 0, -1, 0, 0, given.thickness_mm + 2, given.radius_mm)
        occ.cut([(3, plate)], [(3, hole)])
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 48)
        made = drawn_solid(triangles(8.0, 1e-3))
    expected = closed_form(given.radius_mm)
    print(f"hole {2 * given.radius_mm:g} mm, {given.thickness_mm:g} mm thick, closed form {expected:.3f}\n")
    print("| edges | tets | peak | error | its jump | at the nodes |\n|---|---|---|---|---|---|")
    for edges in (12.0, 16.0, 24.0, 48.0):
        sys.modules["scan2fea.tetmeshing.fill"].PER_TURN = (edges,)
        tets = fill(made.mesh, made.brep, FillOptions(max_elements=400_000, max_nodes=600_000)).tets
        x = np.asarray(tets.nodes)
        middle = {name: x[tets.boundary[tets.face_tag == k][:, :3]].mean((0, 1))[0] for k, name in enumerate(tets.face_names)}
        low, high = min(middle, key=middle.get), max(middle, key=middle.get)
        force = 1e6 * 1e-6 * WIDTH_MM * given.thickness_mm
        options = FeaOptions(supports=("none",), loads=(f"pull: {high} force {force} 0 0", f"pull: {low} force {-force} 0 0"), n_modes=1)
        result = solve(build_model(tets, options), options)
        row = {case.measure: case.value for case in result.cases if case.name == "pull"}
        field = next(f for f in result.fields if f.name == "pull")
        nodal = field.von_mises_pa[np.hypot(x[:, 0], x[:, 1]) < 1.001e-3 * given.radius_mm].max() * 1e-6
        peak = row["stress_peak_pa"] * 1e-6
        cells = f"{peak:.3f} | {100 * (peak / expected - 1):+.1f} % | {100 * row['stress_peak_jump']:.0f} % | {100 * (nodal / expected - 1):+.1f} %"
        print(f"| {edges:g} | {len(tets.tets)} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
