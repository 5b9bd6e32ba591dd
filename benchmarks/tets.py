"""Time, size and worst angle of B-Reps and tet meshes on parts made on the fly. Printed, not asserted.

    python benchmarks/tets.py

One thread. faces: of the B-Rep. cad, tets: wall s. nodes: TET10. min, p01: of the smallest dihedral of each tet, degrees.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from predicates import box, l_beam, moved, rotation, sphere, torus
from scan2fea.cad import to_brep
from scan2fea.kernel.quality import tet_dihedrals
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.types import TriangleMesh


def rough_torus(n: int, m: int) -> TriangleMesh:
    """No two triangles coplanar: every one becomes a facet."""
    ring = torus(n=n, m=m)
    noise = np.random.default_rng(0).normal(0, 1e-4, ring.vertices.shape)
    return TriangleMesh(vertices=ring.vertices + noise, faces=ring.faces)


PARTS = {
    "L-beam 3048 mm, 28 triangles": (l_beam(length=3.048), "auto"),
    "L-beam, B-Rep, kept triangles": (l_beam(length=0.5, pitch=0.00635), "surface"),
    "plate 500 x 300 x 5": (box((0.5, 0.3, 0.005)), "auto"),
    "plate 1000 x 1000 x 2": (box((1.0, 1.0, 0.002)), "auto"),
    "cube": (box(), "auto"),
    "sphere, 5 120 triangles": (sphere(rounds=4), "auto"),
    "rough torus, 4 608 triangles": (rough_torus(72, 32), "auto"),
    "rough torus, 15 872 triangles": (rough_torus(128, 62), "auto"),
}


def main() -> None:
    print(f"{'part':32s} {'faces':>6s} {'MB':>5s} {'cad':>6s} {'tets':>6s} {'number':>7s} {'nodes':>7s} {'min':>5s} {'p01':>5s}  how")
    for name, (mesh, route) in PARTS.items():
        part = moved(mesh, rotation(1), np.zeros(3))
        start = time.perf_counter()
        brep = to_brep(part)
        middle = time.perf_counter()
        filled = fill(part, brep, FillOptions(route=route))
        end = time.perf_counter()
        angle = tet_dihedrals(filled.tets.nodes, filled.tets.tets).min(1)
        counts = f"{len(filled.tets.tets):7d} {len(filled.tets.nodes):7d} {angle.min():5.1f} {np.percentile(angle, 1):5.1f}"
        size = f"{len(brep.face_names):6d} {len(brep.step) / 1e6:5.1f} {middle - start:6.2f} {end - middle:6.2f}"
        print(f"{name:32s} {size} {counts}  {filled.how['route']} {filled.how['done']}")


if __name__ == "__main__":
    main()
