"""Smallest dihedral angle of the tets of every surface of the corpus, by one and the same setting: the defaults of `scan2fea run`.

    python benchmarks/corpus_angles.py OUT.jsonl [--faces N] [--only NAME]   measures what OUT.jsonl lacks, a line each
    python benchmarks/corpus_angles.py OUT.jsonl --table                     prints the table of docs/meshing.md

Parts: those of `meshing.py`. Each is repaired, remeshed to N triangles (2 000; 0: as many as `run` would take), filled and eased by the very function
that `run` calls; facets, no true faces or patches, so that every part goes the way of its triangles. cpu: seconds, the children's too.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from meshing import parts

from scan2fea.cad import CadOptions
from scan2fea.errors import Scan2FeaError
from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import median_edge, tet_volumes, volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.processes import spent_s
from scan2fea.kernel.quality import tet_quality
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.convert import _solid_and_tets
from scan2fea.pipeline.part import Made, Part
from scan2fea.pipeline.record import Record, Tracked
from scan2fea.remeshing import remesh, worst_dihedral
from scan2fea.repair import repair
from scan2fea.tetmeshing.faults import smallest_angles
from scan2fea.types import PointCloud, Scan, TriangleMesh

AIM_DEG, ASKED = 12.0, 0.95


def measured(mesh: TriangleMesh, n_faces: int) -> dict[str, Any]:
    config = Config(cad=CadOptions(true_faces=False, patches=False))
    config = replace(config, remeshing=replace(config.remeshing, max_faces=n_faces or None))
    began = spent_s()
    row: dict[str, Any] = {}
    try:
        fine = spacing(mesh.vertices)
        surface = remesh(repair(mesh, config.repair).mesh, config.remeshing, spacing_m=fine, sigma_m=0.0).mesh
        row["prepared_cpu"] = spent_s() - began
        needle, _, fold, _ = smallest_angles(surface)
        row |= {"faces": len(surface.faces), "needle_deg": needle, "fold_deg": fold}
        none = np.full(len(mesh.vertices), -1)
        cloud = PointCloud(points=mesh.vertices, ray=none, frame=none, raw_index=none)
        made = Made(part=Part(id=1, kind="", scan=Scan(cloud=cloud), mesh=mesh), spacing_m=fine)
        with tempfile.TemporaryDirectory() as folder:
            record = Record(Path(folder))
            tets = _solid_and_tets(made, Tracked(surface, "surface"), config, record).value
        eased = boundary_surface(tets)
        quality = tet_quality(tets.nodes, tets.tets)
        moved = max(float(PointToMesh(a).nearest(b.vertices).distance.max()) for a, b in ((eased, surface), (surface, eased)))
        row |= {"eased": sum(stage["name"] == "ease" for stage in record.stages), "worst_deg": worst_dihedral(tets), "n_tets": len(tets.tets)}
        row |= {"min_deg": float(quality["min_dihedral_deg"].min()), "p01_deg": float(np.percentile(quality["min_dihedral_deg"], 1))}
        row |= {"jacobian": float(quality["scaled_jacobian"].min()), "moved_edges": moved / median_edge(surface)}
        row |= {"eased_volume": volume(eased) / volume(surface) - 1}
        row |= {"tets_volume": float(tet_volumes(tets.nodes, tets.tets).sum()) / volume(eased) - 1, "route": made.how["route"]}
    except Scan2FeaError as error:
        row["refused"] = str(error)
    return {**row, "cpu": spent_s() - began}


def table(rows: list[dict[str, Any]]) -> None:
    print("| part | triangles | needle, fold deg | least, 1 % deg | least Jacobian | tets | eased: times, moved (edges), volume % | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    meshed = [row for row in rows if "refused" not in row]
    for row in meshed:
        angles = f"{row['worst_deg']:.1f}, {row['p01_deg']:.1f}"
        eased = f"{row['eased']}, {row['moved_edges']:.2f}, {100 * row['eased_volume']:+.3f}" if row["eased"] else ""
        limits = f"{row['needle_deg']:.0f}, {row['fold_deg']:.0f}"
        print(f"| {row['part']} | {row['faces']} | {limits} | {angles} | {row['jacobian']:.2f} | {row['n_tets']} | {eased} | {row['cpu']:.0f} |")
    for row in rows:
        if "refused" in row:
            print(f"- {row['part']}: {row['refused']}")
    good = sum(row["worst_deg"] >= AIM_DEG for row in meshed)
    share = good / max(len(meshed), 1)
    least = min((row["worst_deg"] for row in meshed), default=float("nan"))
    print(f"{good} of {len(meshed)} at {AIM_DEG:g} degrees or over ({share:.1%}, asked {ASKED:.0%}); least {least:.1f}")
    print(f"{len(rows) - len(meshed)} refused")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--faces", type=int, default=2000)
    parser.add_argument("--only", default="")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    done = {row["part"] for row in rows}
    for name, make in [] if given.table else parts(quick=False):
        if name in done or given.only not in name:
            continue
        try:
            row = {"part": name, **measured(make(), given.faces)}
        except Scan2FeaError as error:
            row = {"part": name, "refused": str(error), "cpu": 0.0}
        rows.append(row)
        with given.out.open("a") as stream:
            stream.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
    table(rows)


if __name__ == "__main__":
    main()
