"""Tets of a corpus, before and after our optimisers, beside gmsh's own and CGAL's; and the speed of the relaxations.

    python benchmarks/meshing.py OUT.jsonl [--quick] [--cgal PYTHON]     measures what OUT.jsonl lacks, a line each
    python benchmarks/meshing.py OUT.jsonl --table                       prints the tables of docs/meshing.md

Parts: made here (dirty ones too), the meshes and the STEP files (meshed by gmsh) of SCAN2FEA_DATA. Each is repaired and remeshed as in `scan2fea
run`, then filled, face by face where they are few planes; the deck of our tets goes through CalculiX, and its displacements at all nodes (7 digits)
beside ours. PYTHON: an interpreter with the `cgal` wheel; its Mesh_3 meshes the same surface at the same edge, then ODT, Lloyd, perturbation and
exudation. cpu: seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from cad import MADE, meshed
from predicates import box, l_beam, sphere, torus
from scan2fea.cad import to_brep
from scan2fea.errors import Scan2FeaError
from scan2fea.fea import FeaOptions, build_model, write_inp
from scan2fea.fea.assemble import assemble
from scan2fea.fea.linear import Shared
from scan2fea.fea.solve import _tree
from scan2fea.fea.static import Statics
from scan2fea.io import read_mesh
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import tet_volumes, volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.quality import tet_quality, triangle_quality
from scan2fea.kernel.topology import surface_topology
from scan2fea.remeshing import RemeshOptions, remesh
from scan2fea.remeshing.lloyd import lloyd
from scan2fea.remeshing.odt import odt
from scan2fea.repair import RepairOptions, repair
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.tetmeshing.faults import smallest_angles
from scan2fea.tetmeshing.optimise import OptimiseOptions, optimised
from scan2fea.types import TetMesh, TriangleMesh

MAX_FACES = 2000
MAX_DOF = 45_000  # of decks that go through CalculiX
ORACLE = """
import sys, time, numpy as np
from CGAL.CGAL_Polyhedron_3 import Polyhedron_3
from CGAL import CGAL_Mesh_3 as M
off, edge, out = sys.argv[1], float(sys.argv[2]), sys.argv[3]
domain = M.Polyhedral_mesh_domain_3(Polyhedron_3(off))
criteria = M.Default_mesh_criteria()
criteria.facet_angle(25).facet_size(edge).facet_distance(edge / 10).cell_radius_edge_ratio(2).cell_size(edge)
parameters = M.Mesh_3_parameters()  # no ODT, no Lloyd
parameters.no_perturb()
parameters.no_exude()
mesh = M.make_mesh_3(domain, criteria, parameters)
began = time.process_time()
M.odt_optimize_mesh_3(mesh, domain, 60, 20, 0.02, 0.01)
M.lloyd_optimize_mesh_3(mesh, domain, 60, 20, 0.02, 0.01)
M.perturb_mesh_3(mesh, domain, 60, 0)
M.exude_mesh_3(mesh, 60, 0)
cpu = time.process_time() - began
mesh.output_to_medit(out)
print(cpu)
"""


def parts(quick: bool) -> Iterator[tuple[str, Callable[[], TriangleMesh]]]:
    yield "L-beam 3048 mm", lambda: l_beam(length=3.048)
    yield "plate 500 x 300 x 5", lambda: box((0.5, 0.3, 0.005))
    yield "cube", box
    yield "sphere", lambda: sphere(rounds=4)
    yield "torus", lambda: torus(n=72, m=32)
    for name, edge in MADE.items():
        yield name, lambda name=name, edge=edge: meshed(name, edge)[0]
    yield from dirty()
    data = Path(os.environ.get("SCAN2FEA_DATA", "data"))
    files = sorted(path for folder in ("meshes", "cad_gt") for path in (data / folder).rglob("*") if path.is_file() and ".xyz" not in path.name)
    for path in [] if quick else files:
        if path.suffix.lower() in (".stp", ".step"):
            yield f"{path.parent.name}/{path.name}", lambda path=path: meshed(str(path), 0.0)[0]
        elif path.suffix.lower() in (".off", ".obj", ".stl", ".ply") and "points" not in path.parent.name:
            yield f"{path.parent.name}/{path.name}", lambda path=path: read_mesh(path)


def dirty() -> Iterator[tuple[str, Callable[[], TriangleMesh]]]:
    beam, ball = l_beam(length=0.5, pitch=0.00635), sphere(rounds=4)
    for share in (0.1, 0.3):
        noise = share * 0.00635 * np.random.default_rng(0).standard_normal(beam.vertices.shape)
        yield f"dirty: L-beam, noise {share} t", lambda noise=noise: replace(beam, vertices=beam.vertices + noise)
    gaps = np.random.default_rng(0).random(len(ball.faces)) > 0.01
    yield "dirty: sphere, 1 % of its faces missing", lambda: replace(ball, faces=ball.faces[gaps])
    both = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    for name, second in (("two spheres that cross", ball.vertices + np.array([1.0, 0, 0])), ("sphere in a sphere", ball.vertices / 2)):
        yield f"dirty: {name}", lambda second=second: TriangleMesh(vertices=np.concatenate([ball.vertices, second]), faces=both)
    yield "dirty: inside out", lambda: replace(ball, faces=ball.faces[:, ::-1])
    yield "dirty: no volume", lambda: replace(ball, vertices=ball.vertices * [1.0, 1.0, 0.0])


def prepared(mesh: TriangleMesh) -> TriangleMesh:
    """As the chain does it."""
    fine = spacing(mesh.vertices)
    sound = repair(mesh, RepairOptions()).mesh
    return remesh(sound, RemeshOptions(max_faces=MAX_FACES), spacing_m=fine, sigma_m=0.0).mesh


def shape_of(tets: TetMesh) -> dict[str, float]:
    quality = tet_quality(tets.nodes, tets.tets)
    angle = quality["min_dihedral_deg"]
    return {
        "n_tets": len(tets.tets), "min": float(angle.min()), "p01": float(np.percentile(angle, 1)), "median": float(np.median(angle)),
        "jacobian": float(quality["scaled_jacobian"].min()),
    }  # fmt: skip


def measured(name: str, make: Callable[[], TriangleMesh], cgal: str) -> dict[str, Any]:
    row: dict[str, Any] = {"part": name}
    try:
        given = make()
        row["closed"] = surface_topology(given).is_closed
        mesh = prepared(given)
        needle, _, fold, _ = smallest_angles(mesh)
        row |= {"faces": len(mesh.faces), "needle_deg": needle, "fold_deg": fold}
        brep = to_brep(mesh)
        for key, options in (("gmsh", FillOptions(optimise="none")), ("own", FillOptions())):
            began = time.process_time()
            filled = fill(mesh, brep, options)
            row["route"] = filled.how["route"]
            row[key] = {**shape_of(filled.tets), "cpu": time.process_time() - began}
            row[key]["volume_off"] = float(tet_volumes(filled.tets.nodes, filled.tets.tets).sum()) / volume(mesh) - 1
        row["volume_off_given"] = volume(mesh) / volume(given) - 1 if row["closed"] else None
        row["deck"] = through_calculix(filled.tets)
        if cgal:
            row["cgal"] = oracle(mesh, cgal)
    except Scan2FeaError as error:
        row["refused"] = str(error)
    return row


def through_calculix(tets: TetMesh) -> dict[str, Any]:
    """Exit code of CalculiX on the whole deck, and the largest difference of its self weight to ours, of the largest displacement."""
    if shutil.which("ccx") is None or 3 * len(tets.nodes) > MAX_DOF:
        return {}
    model = build_model(tets)
    system = assemble(model.mesh, model.material)
    began = time.process_time()
    ours = Statics(model, system, Shared(system, _tree(model, system, None), FeaOptions()), FeaOptions()).self_weight()[1].displacement_m
    row: dict[str, Any] = {"dof": 3 * len(tets.nodes), "cpu": time.process_time() - began}
    text = re.sub(r"(\*NODE PRINT[^\n]*\nRF)", "*NODE PRINT, NSET=ALL\nU\n\\1", write_inp(model))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "m.inp").write_text(text)
        ran = subprocess.run(["ccx", "-i", "m"], cwd=folder, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False)
        row["ccx"] = ran.returncode
        if ran.returncode == 0:
            block = Path(folder, "m.dat").read_text().split("displacements", 1)[1].split("total force", 1)[0]
            rows = np.array([line.split() for line in block.splitlines() if re.match(r"\s+\d+\s+\S+\s+\S+\s+\S+\s*$", line)], float)
            theirs = np.zeros_like(ours)
            theirs[rows[:, 0].astype(int) - 1] = rows[:, 1:]
            row["off"] = float(np.abs(theirs - ours).max() / np.abs(theirs).max())
    return row


def oracle(mesh: TriangleMesh, python: str) -> dict[str, Any]:
    edge = float(np.median(np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)))
    with tempfile.TemporaryDirectory() as folder:
        off, out = Path(folder) / "in.off", Path(folder) / "out.mesh"
        lines = [" ".join(repr(float(x)) for x in v) for v in mesh.vertices] + [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
        off.write_text("\n".join(["OFF", f"{len(mesh.vertices)} {len(mesh.faces)} 0", *lines]) + "\n")
        try:
            told = subprocess.run([python, "-c", ORACLE, str(off), str(edge), str(out)], capture_output=True, text=True, timeout=300, check=True)
        except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
            return {"failed": type(error).__name__}
        nodes, tets = _medit(out)
    quality = tet_quality(nodes, np.where((tet_volumes(nodes, tets) < 0)[:, None], tets[:, [1, 0, 2, 3]], tets))["min_dihedral_deg"]
    return {"n_tets": len(tets), "min": float(quality.min()), "p01": float(np.percentile(quality, 1)), "cpu": float(told.stdout.split()[-1])}


def _medit(path: Path) -> tuple[np.ndarray, np.ndarray]:
    words = path.read_text().split()
    at = words.index("Vertices")
    n = int(words[at + 1])
    nodes = np.array(words[at + 2 : at + 2 + 4 * n], float).reshape(n, 4)[:, :3]
    at = words.index("Tetrahedra")
    m = int(words[at + 1])
    return nodes, np.array(words[at + 2 : at + 2 + 5 * m], np.int64).reshape(m, 5)[:, :4] - 1


def speeds(quick: bool) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
    n = 72 if quick else 320

    def surface(method: Callable[..., Any]) -> dict[str, Any]:
        mesh = torus(n=n, m=n // 2)
        rng = np.random.default_rng(0)
        edge = float(np.median(np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)))
        mesh = replace(mesh, vertices=mesh.vertices + rng.normal(0, 0.02 * edge, mesh.vertices.shape))
        method(mesh, 1)
        began = time.process_time()
        made, found = method(mesh, 200)
        cpu = time.process_time() - began
        away = max(PointToMesh(made).nearest(mesh.vertices).distance.max(), PointToMesh(mesh).nearest(made.vertices).distance.max()) / edge
        angle = triangle_quality(made.vertices, made.faces)["min_angle_deg"]
        energy = float(found.energies[-1] / found.energies[0])
        return {"faces": len(mesh.faces), "iterations": found.iterations, "ended": found.why, "cpu": cpu, "hausdorff_edges": float(away),
                "energy": energy, "min_angle": float(angle.min())}  # fmt: skip

    def volume_() -> dict[str, Any]:
        solid = sphere(rounds=3 if quick else 5)
        filled = fill(solid, None, FillOptions(optimise="none", order=1, growth=0.05 if quick else 0.02, max_elements=10**7, time_limit_s=500.0))
        nodes, tets = filled.tets.nodes, filled.tets.tets
        began = time.process_time()
        found = optimised(nodes, tets, OptimiseOptions(target_deg=35.0))  # 25 is the default and needs no exudation here; 40 is out of reach
        cpu = time.process_time() - began
        worst = [row["measures"]["min_dihedral_deg"]["min"] for row in found.log]
        return {"n_tets": len(tets), "cpu": cpu, "worst": worst, "steps": [row["step"] for row in found.log]}

    yield "surface Lloyd", lambda: surface(lloyd)
    yield "surface ODT", lambda: surface(odt)
    yield "volume, four steps", volume_


def table(rows: list[dict[str, Any]]) -> None:
    print("| part | faces | needle, fold deg | gmsh | own | CGAL | Jacobian gmsh / own | tets | volume % | ccx, off | s gmsh / own / CGAL |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for row in rows:
        if "part" not in row:
            continue
        if "refused" in row:
            print(f"| {row['part']} | {row.get('faces', '-')} | refused: {row['refused'][:110]} | | | | | | | | |")
            continue
        cgal = row.get("cgal") or {}
        oracle_told = f"{cgal['min']:.1f} / {cgal['p01']:.1f}" if "min" in cgal else cgal.get("failed", "-")
        both = " | ".join(f"{row[key]['min']:.1f} / {row[key]['p01']:.1f}" for key in ("gmsh", "own"))
        cpu = f"{row['gmsh']['cpu']:.1f} / {row['own']['cpu']:.1f} / {cgal.get('cpu', float('nan')):.1f}"
        jacobian = " / ".join(f"{row[key]['jacobian']:.2f}" for key in ("gmsh", "own"))
        off = f"{100 * row['volume_off_given']:+.2f}" if row.get("volume_off_given") is not None else "-"
        deck = f"{row['deck']['ccx']}, {row['deck'].get('off', float('nan')):.0e}" if row.get("deck") else "-"
        limits = f"{row['needle_deg']:.0f}, {row['fold_deg']:.0f}"
        n = row["own"]["n_tets"]
        print(f"| {row['part']} | {row['faces']} | {limits} | {both} | {oracle_told} | {jacobian} | {n} | {off} | {deck} | {cpu} |")
    for row in rows:
        if "speed" in row:
            print(json.dumps(row))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--cgal", default="")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    if given.table:
        table(rows)
        return
    done = {row.get("part") or row["speed"] for row in rows}
    for name, make in parts(given.quick):
        if name not in done:
            _write(given.out, measured(name, make, given.cgal))
    for name, run in speeds(given.quick):
        if name not in done:
            _write(given.out, {"speed": name, **run()})


def _write(path: Path, row: dict[str, Any]) -> None:
    with path.open("a") as stream:
        stream.write(json.dumps(row) + "\n")
    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
