"""A free-form body of 100 000 triangles to STEP: processor seconds and peak memory of each way. Printed, not asserted.

    python benchmarks/free_form.py [number of triangles] [patches|chain|facets]...

patches: NURBS patches over the triangles as they are; chain: remeshed first, as `scan2fea run` does it; facets: a face a triangle.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from predicates import torus
from scan2fea.cad import CadOptions, to_brep
from scan2fea.pipeline.free_form import _patched
from scan2fea.remeshing import remesh
from scan2fea.types import TriangleMesh

NOISE = 0.02  # of an edge


def body(n_faces: int) -> tuple[TriangleMesh, float]:
    """A ring with bumps, and its edge length."""
    n = 2 * round((n_faces / 4) ** 0.5)
    ring = torus(n=n, m=n // 2)
    v = np.asarray(ring.vertices)
    k = 3 / np.ptp(v, axis=0).max()
    bump = 0.03 / k * 3 * (np.sin(7 * k * v[:, :1]) * np.cos(5 * k * v[:, 1:2]) + np.sin(9 * k * v[:, 2:]))
    v = (v + bump * v / np.linalg.norm(v, axis=1, keepdims=True)) * [1.0, 0.8, 1.1]
    edge = float(np.median(np.linalg.norm(v[ring.faces[:, 0]] - v[ring.faces[:, 1]], axis=1)))
    return TriangleMesh(vertices=v + np.random.default_rng(0).normal(0, NOISE * edge, v.shape), faces=ring.faces), edge


def cpu() -> float:
    return time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def main(n_faces: str = "100000", *ways: str) -> None:
    mesh, edge = body(int(n_faces))
    noise = NOISE * edge
    for way in ways or ("patches", "chain", "facets"):
        began = cpu()
        surface = remesh(mesh, spacing_m=edge, sigma_m=noise).mesh if way == "chain" else mesh
        if way == "facets":
            brep, reason = to_brep(surface, CadOptions(max_faces=4 * len(surface.faces))), ""
        else:
            found = _patched(surface, CadOptions(), spacing_m=edge, noise_m=noise)
            brep, reason = found.brep, found.reason
        sound = f"valid {brep.is_valid}, {brep.n_free_edges} free edges" if brep else reason
        told = f"{len(brep.face_names)} faces, {len(brep.step) / 1e6:.1f} MB, {sound}" if brep else sound
        peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024
        print(f"{way}: {len(mesh.faces)} triangles, {told}; {cpu() - began:.1f} cpu s, {peak:.0f} MB", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
