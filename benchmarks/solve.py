"""Time and memory of the embedded solver beside CalculiX on the same deck.

    OMP_NUM_THREADS=1 python benchmarks/solve.py [thin|compact] [target size of the elements, m] [all]

thin: angle 127 x 127 x 6.35 x 3048 mm; compact: ball of 1 m radius. Meshed by gmsh, TET10. Both solve the self weight, each in a process of its own:
reading the deck or assembling, factors, displacements, stresses, reactions. With `all` CalculiX finds four supported modes too, ours four free ones.
"""

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gmsh
import numpy as np

from scan2fea.fea import FeaOptions, build_model, solve, write_inp
from scan2fea.fea.assemble import assemble
from scan2fea.fea.linear import Shared
from scan2fea.fea.solve import _tree
from scan2fea.fea.static import Statics
from scan2fea.io.artifacts import load, save
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


def alone(path):
    """The static step of a mesh in a file, in this process: what it took, and the largest displacement."""
    mesh = load(Path(path))
    model, options = build_model(mesh), FeaOptions()
    start, cpu = time.perf_counter(), time.process_time()
    system = assemble(model.mesh, model.material)
    rows, _, solver = Statics(model, system, Shared(system, _tree(model, system, None), options), options).self_weight()
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    print(json.dumps({"s": seconds, "cpu": cpu, "mb": _peak_mb(), "solver": solver, "largest": rows[0].value}))


def _peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _calculix(deck):
    """Seconds of wall clock and processor, MB at the peak, largest displacement in m."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "model.inp").write_text(deck)
        start = time.perf_counter()
        with Path(folder, "told").open("wb") as told:
            ran = subprocess.Popen(["ccx", "-i", "model"], cwd=folder, stdout=told, stderr=told, env={**os.environ, "OMP_NUM_THREADS": "1"})
            _, status, used = os.wait4(ran.pid, 0)
        seconds = time.perf_counter() - start
        if status:
            raise SystemExit(f"  CalculiX ended with status {status} after {used.ru_utime + used.ru_stime:.1f} s cpu, {used.ru_maxrss / 1024:.0f} MB")
        block = Path(folder, "model.frd").read_text().split(" -4  DISP")[1].split("\n -3")[0]
    u = [[float(line[k : k + 12]) for k in (13, 25, 37)] for line in block.splitlines() if line.startswith(" -1")]
    return seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, float(np.linalg.norm(u, axis=1).max())


def main(kind="thin", size=None, what="static"):
    mesh = meshed(kind, float(size or SIZES[kind]))
    model = build_model(mesh)
    print(f"{kind}: {len(mesh.nodes)} nodes, {len(mesh.tets)} tets, {3 * len(mesh.nodes)} dof", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        save(mesh, Path(folder, "mesh.npz"))
        told = subprocess.run([sys.executable, __file__, "--alone", f"{folder}/mesh.npz"], check=True, capture_output=True, text=True).stdout
    own = json.loads(told)
    took = f"{own['s']:6.1f} s wall {own['cpu']:6.1f} s cpu {own['mb']:6.0f} MB"
    print(f"  static: scan2fea  {took}  {own['largest']:.7g} m  {own['solver']}", flush=True)
    if what == "all":
        start, cpu = time.perf_counter(), time.process_time()
        ours = solve(model)
        seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
        print(f"  all:    scan2fea  {seconds:6.1f} s wall {cpu:6.1f} s cpu {_peak_mb():6.0f} MB  {ours.solver}", flush=True)
        for case in ours.cases:
            print(f"             {case.name}.{case.measure} = {case.value:.6g} {case.unit}")
    if shutil.which("ccx") is None:
        print("  CalculiX   is not installed here")
        return
    deck = write_inp(model)
    static = deck[: re.search(r"\*\* step \d+: modes", deck).start()]
    for name, text in [("static", static)] + ([("all", deck)] if what == "all" else []):
        seconds, cpu, megabytes, largest = _calculix(text)
        print(f"  {name + ':':7s} CalculiX  {seconds:6.1f} s wall {cpu:6.1f} s cpu {megabytes:6.0f} MB  {largest:.7g} m", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--alone"]:
        alone(sys.argv[2])
    else:
        main(*sys.argv[1:])
