"""Time and memory of the embedded solver beside CalculiX on the same deck.

    OMP_NUM_THREADS=1 python benchmarks/solve.py [thin|compact] [target size of the elements, m]

thin: angle 127 x 127 x 6.35 x 3048 mm; compact: ball of 1 m radius. Meshed by gmsh, TET10. CalculiX does its static step and four
supported modes; ours the same static step and four free modes.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gmsh
import numpy as np

from scan2fea.fea import build_model, solve, write_inp
from scan2fea.types import TetMesh

SIZES = {"thin": 0.0127, "compact": 0.13}


def meshed(kind, size):
    """A TetMesh of order 2 with straight sides, one name for each CAD face."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    occ = gmsh.model.occ
    if kind == "thin":
        occ.fuse([(3, occ.addBox(0, 0, 0, 0.127, 0.00635, 3.048))], [(3, occ.addBox(0, 0, 0, 0.00635, 0.127, 3.048))])
    else:
        occ.addSphere(0, 0, 0, 1)
    occ.synchronize()
    for name, value in (("MeshSizeMax", size), ("MeshSizeMin", size), ("Algorithm3D", 10), ("SecondOrderLinear", 1)):
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    tags, x, _ = gmsh.model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, np.int64)
    place[tags] = np.arange(len(tags))
    tets = place[gmsh.model.mesh.getElementsByType(11)[1]].reshape(-1, 10)[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
    faces, tag = [], []
    surfaces = [s for _, s in gmsh.model.getEntities(2)]
    for k, surface in enumerate(surfaces):
        found = place[gmsh.model.mesh.getElementsByType(9, surface)[1]].reshape(-1, 6)
        faces.append(found)
        tag.append(np.full(len(found), k))
    gmsh.finalize()
    boundary = np.concatenate(faces)
    used, packed = np.unique(tets, return_inverse=True)
    names = tuple(f"FACE_{k + 1:02d}_PLANE" for k in range(len(surfaces)))
    place = np.searchsorted(used, boundary)
    return TetMesh(nodes=x.reshape(-1, 3)[used], tets=packed.reshape(-1, 10), boundary=place, face_tag=np.concatenate(tag), face_names=names)


def main(kind="thin", size=None):
    mesh = meshed(kind, float(size or SIZES[kind]))
    model = build_model(mesh)
    start, cpu = time.perf_counter(), time.process_time()
    ours = solve(model)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{kind}: {len(mesh.nodes)} nodes, {len(mesh.tets)} tets, {ours.n_dof} dof")
    print(f"  scan2fea   {seconds:6.1f} s wall {cpu:6.1f} s cpu {megabytes:6.0f} MB peak   {ours.solver}")
    for case in ours.cases:
        print(f"             {case.name}.{case.measure} = {case.value:.6g} {case.unit}")
    if shutil.which("ccx") is None:
        print("  CalculiX   is not installed here")
        return
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "model.inp").write_text(write_inp(model))
        start = time.perf_counter()
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(["ccx", "-i", "model"], cwd=folder, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        print(f"  CalculiX   {seconds:6.1f} s wall {cpu:6.1f} s cpu")


if __name__ == "__main__":
    main(*sys.argv[1:])
