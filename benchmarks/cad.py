"""Faces of known CAD bodies recovered from their noisy triangles: number of faces of each kind, volume, CPU time. Printed, not asserted.

    python benchmarks/cad.py [--quick] [--state FILE] [--only NAME] [--data FOLDER] [--limit SECONDS] [--seeds 0,1]

Bodies: a bracket, plate, tube, flange, vessel, open tank, table and girder made here, and the STEP files below FOLDER.
Each is meshed by gmsh, its vertices get Gaussian noise, and `true_solid` runs in a child process of at most SECONDS. Each run is one line of the
state file (JSON); a second call goes on where the first stopped.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gmsh
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from drawn import triangles
from scan2fea.cad import true_solid
from scan2fea.cad.readback import shape_of_step, volume_of
from scan2fea.kernel.measures import extent
from scan2fea.repair import repair
from scan2fea.types import TriangleMesh

MM = 1e-3
NOISE_MM = (0.0, 0.1, 0.3)
KINDS = {"Plane": "plane", "Cylinder": "cylinder", "Cone": "cone", "Sphere": "sphere", "Torus": "torus"}
MADE = {"bracket": 3.0, "plate": 4.0, "tube": 8.0, "flange": 4.0, "vessel": 8.0, "tank": 6.0, "table": 12.0, "girder": 12.0}  # edge length, mm


def body(name):
    """Build a body in the current gmsh model, millimetres."""
    occ = gmsh.model.occ

    def cut(a, tools):
        return occ.cut(a, tools)[0]

    def drum(r, depth, top):
        ball = occ.addSphere(0, 0, 0, r)
        occ.dilate([(3, ball)], 0, 0, 0, 1, 1, depth / r)
        return occ.fuse([(3, occ.addCylinder(0, 0, 0, 0, 0, top, r))], [(3, ball)])[0]

    if name == "bracket":
        solid, _ = occ.fuse([(3, occ.addBox(0, 0, 0, 100, 80, 8))], [(3, occ.addBox(0, 0, 0, 8, 80, 90))])
        holes = [(3, occ.addCylinder(x, y, -1, 0, 0, 20, 6)) for x, y in ((35, 20), (35, 60), (75, 40))]
        cut(solid, holes + [(3, occ.addCylinder(-1, y, 55, 20, 0, 0, 8)) for y in (20, 60)])
    elif name == "plate":
        places = ((30, 30, 10), (170, 30, 10), (100, 60, 30), (30, 90, 6), (170, 90, 6))
        cut([(3, occ.addBox(0, 0, 0, 200, 120, 10))], [(3, occ.addCylinder(x, y, -1, 0, 0, 20, r)) for x, y, r in places])
    elif name == "tube":
        cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 400, 57))], [(3, occ.addCylinder(0, 0, -1, 0, 0, 402, 51))])
    elif name == "flange":
        solid, _ = occ.fuse([(3, occ.addCylinder(0, 0, 0, 0, 0, 15, 80))], [(3, occ.addCone(0, 0, 15, 0, 0, 40, 45, 35))])
        bolts = [(3, occ.addCylinder(62 * np.cos(t), 62 * np.sin(t), -1, 0, 0, 20, 7)) for t in np.arange(8) * np.pi / 4]
        cut(solid, [(3, occ.addCylinder(0, 0, -1, 0, 0, 99, 25)), *bolts])
    elif name == "vessel":
        top = drum(60, 30, 120)
        ball = occ.addSphere(0, 0, 0, 60)
        occ.dilate([(3, ball)], 0, 0, 0, 1, 1, 0.5)
        occ.translate([(3, ball)], 0, 0, 120)
        occ.fuse(occ.fuse(top, [(3, ball)])[0], [(3, occ.addCylinder(0, 0, 60, 100, 0, 0, 20))])
    elif name == "tank":
        cut(drum(60, 30, 120), drum(50, 20, 140))
    elif name == "table":
        legs = [(3, occ.addBox(x, y, 0, 40, 40, 300)) for x in (20, 340) for y in (20, 190)]
        occ.fuse([(3, occ.addBox(0, 0, 300, 400, 250, 20))], legs)
    elif name == "girder":
        plates = [(-75, -100, 0, 150, 15, 900), (-75, 85, 0, 150, 15, 900), (-5, -85, 0, 10, 170, 900)]
        plates += [(x, -85, z - 5, 50, 170, 10) for x in (-55, 5) for z in (225, 450, 675)]
        boxes = [(3, occ.addBox(*p)) for p in plates]
        occ.fuse(boxes[:1], boxes[1:])
    else:
        occ.importShapes(name)


def exact_volume():
    """m3 of the current gmsh model; its own getMass is 0.12 % short of the vessel's closed form."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.step"
        gmsh.write(str(path))
        return volume_of(shape_of_step(path)) * MM**3


def meshed(name, edge):
    """Triangles in metres, true counts of faces and volume."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        body(name)
        gmsh.model.occ.synchronize()
        kinds = {}
        for entity in gmsh.model.getEntities(2):
            kind = KINDS.get(gmsh.model.getType(*entity), "other")
            kinds[kind] = kinds.get(kind, 0) + 1
        held = exact_volume()
        low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
        mesh = triangles(edge or np.linalg.norm(high - low) / 60, MM)
    finally:
        gmsh.finalize()
    return repair(mesh).mesh, kinds, held


def one(name, edge, noise_mm, seed=0):
    """The row of one run."""
    mesh, kinds, held = meshed(name, edge)
    points = mesh.vertices + noise_mm * MM * np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    spacing = float(np.median(np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)))
    began = time.process_time()
    found = true_solid(TriangleMesh(vertices=points, faces=mesh.faces), points, spacing_m=spacing, noise_m=noise_mm * MM)
    row = {"true": kinds, "n_true": sum(kinds.values()), "triangles": len(mesh.faces), "size_mm": extent(points) / MM}
    row["cpu_s"] = time.process_time() - began
    if found.brep is None:
        return {**row, "reason": found.reason}
    ours = {kind: found.brep.face_kinds.count(kind) for kind in sorted(set(found.brep.face_kinds))}
    told = {"applied": sum(s.applied for s in found.snaps), "refused": sum(not s.applied for s in found.snaps)}
    return {**row, "ours": ours, "n_ours": len(found.brep.face_kinds), "volume": found.brep.volume_m3 / held - 1, **told}


def main():
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--quick", action="store_true", help="noise 0.1 mm only, bodies made here only")
    ask.add_argument("--state", type=Path, default=Path(tempfile.gettempdir()) / "scan2fea-cad.jsonl")
    ask.add_argument("--only", default="")
    ask.add_argument("--data", type=Path, help="folder searched for .stp and .step files")
    ask.add_argument("--limit", type=float, default=300.0, help="seconds a run may take")
    ask.add_argument("--seeds", default="0", help="of the noise, as 0,1,2")
    ask.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    args = ask.parse_args()
    if args.child:
        name, edge, noise, seed = args.child
        print("\nROW " + json.dumps(one(name, float(edge), float(noise), int(seed))))
        return
    cases = [(name, edge) for name, edge in MADE.items()]
    if args.data and not args.quick:
        cases += [(str(p), 0.0) for p in sorted(args.data.rglob("*")) if p.suffix.lower() in (".stp", ".step")]
    done = [json.loads(line) for line in args.state.read_text().splitlines()] if args.state.exists() else []
    for name, edge in cases:
        for noise, seed in itertools.product(NOISE_MM[1:2] if args.quick else NOISE_MM, map(int, args.seeds.split(","))):
            title = Path(name).name  # of a file with its suffix: a body made here may bear the same name
            if args.only not in title or any((r["body"], r["noise_mm"], r.get("seed", 0)) == (title, noise, seed) for r in done):
                continue
            command = [sys.executable, __file__, "--child", name, str(edge), str(noise), str(seed)]
            try:
                ran = subprocess.run(command, capture_output=True, text=True, timeout=args.limit, check=False)
                lines = [line for line in ran.stdout.splitlines() if line.startswith("ROW ")]
                row = json.loads(lines[0][4:]) if lines else {"reason": (ran.stderr.strip().splitlines() or ["died"])[-1]}
            except subprocess.TimeoutExpired:
                row = {"reason": f"over {args.limit:g} s of wall clock"}
            done.append({"body": title, "noise_mm": noise, "seed": seed, **row})
            with args.state.open("a") as file:
                file.write(json.dumps(done[-1]) + "\n")
    print("| body | noise mm | seed | true faces | ours | volume % | relations applied, refused | CPU s |\n|---|---|---|---|---|---|---|---|")
    for r in done:
        if args.only not in r["body"]:
            continue
        ours = f"{r['n_ours']} {r['ours']}" if "ours" in r else f"facets: {r['reason']}"
        volume = f"{100 * r['volume']:+.3f}" if "volume" in r else ""
        snaps = f"{r['applied']}, {r['refused']}" if "applied" in r else ""
        true = f"{r.get('n_true', '')} {r.get('true', '')}"
        print(f"| {r['body']} | {r['noise_mm']} | {r.get('seed', 0)} | {true} | {ours} | {volume} | {snaps} | {r.get('cpu_s', 0):.1f} |")


if __name__ == "__main__":
    main()
