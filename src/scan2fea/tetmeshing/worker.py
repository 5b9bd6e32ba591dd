"""The child process that runs gmsh, or fTetWild: `python -P worker.py JOB.npz RESULT.npz`.

gmsh may crash, hang or eat memory on a bad surface; in a process of its own it takes nothing else along. The file is run by its path, so that it
loads gmsh and numpy and not the rest of the package. It talks through two npz files and exits with 0 also where gmsh refuses (`error` says why).

Job: kind "brep" (step, shift_mm, size_mm, max_size_mm, max_tets, max_nodes, per_turn: edges round a circle), "surface" (vertices, faces, growth)
or "dirty" (vertices, faces, envelope: share of the diagonal by which fTetWild may move the surface); memory_gib; but for "dirty" also algorithm
"hxt", "delaunay", "auto" (by the shape of the triangles) or "other" (than auto takes), and good_deg: no optimisation above.
Result, in the units of the job: nodes (n, 3), tets (m, 4); but for "dirty" also tags (n,) gmsh's numbers of the nodes, min_dihedral_deg, done (what
ran, as text); brep also triangles (k, 3), face (k,) index of the STEP face of each, of curved solids (per_turn > 0) middles (k, 3, 3) of their edges
01 12 20 on the face or its border, `coarser` than asked by, per_turn as it came out, and face_centre, face_area of each STEP face, by which the
caller proves the order.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import mmap
import os
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.kernel.quality import tet_dihedrals, triangle_angles
from scan2fea.types import FloatArray, IntArray

HXT, DELAUNAY = 10, 1  # Mesh.Algorithm3D
# HXT took 50 s and more on surfaces with needles (an L-beam bisected down to 2 deg, a bracket with facetted holes), under a second on clean ones
NEEDLE_DEG = 12.0
SPLINES = ("BSpline surface", "BSpline", "Nurb")  # as gmsh calls them
NARROW_FACTOR = 2.5  # elements beside a narrow face may be so much longer than it is wide: smallest triangle angle about 20 deg
_SAME = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p)(lambda _: 1)  # kept here: the library goes on calling it
GROWTH = 0.4  # metres of edge per metre of distance


def main(job_path: str, result_path: str) -> None:
    """Run the job and write the result; an error of gmsh is a result too."""
    with np.load(job_path) as archive:
        job = {name: archive[name] for name in archive.files}
    _limit_memory(float(job["memory_gib"]))
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    np.savez(result_path, **(_wild(job) if str(job["kind"]) == "dirty" else _gmsh(job)))


def _gmsh(job: dict[str, Any]) -> dict[str, Any]:
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        found = _run(gmsh, job)
    except Exception as error:  # noqa: BLE001 - gmsh raises bare Exception; the reason goes to the parent
        reasons = dict.fromkeys(str(r).strip() for r in (error, gmsh.logger.getLastError()) if str(r).strip())
        found = {"error": np.array("; ".join(reasons) or type(error).__name__)}
    gmsh.finalize()
    return found


def _wild(job: dict[str, Any]) -> dict[str, Any]:
    """fTetWild (Hu et al. 2020). Its package loads pyvista, which nothing here needs, so the compiled module is loaded alone."""
    package = importlib.util.find_spec("pytetwild")
    folders = package.submodule_search_locations if package is not None else None
    spec = PathFinder.find_spec("PyfTetWildWrapper", folders)
    if spec is None or spec.loader is None:
        return {"error": np.array("pytetwild has no PyfTetWildWrapper: install pytetwild again")}
    wrapper = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(wrapper)
    if not _without_chance(Path(str(spec.origin)).name):
        return {"error": np.array("fTetWild draws at random on this system, so that no run could be repeated")}
    none = np.zeros((0, 3)), np.zeros((0, 4), np.int32), np.zeros(0)
    optimise, as_it_is, edge, stop_energy, coarsen, threads, rounds, silent, quiet = True, False, 0.05, 10.0, False, 1, 80, 6, True
    nodes, tets = wrapper.tetrahedralize_mesh(
        job["vertices"], job["faces"].astype(np.uint32), optimise, as_it_is, edge, 0.0, float(job["envelope"]), stop_energy, coarsen, threads, rounds,
        silent, quiet, False, False, *none,
    )  # fmt: skip
    return {"nodes": nodes, "tets": tets[:, [1, 0, 2, 3]].astype(np.int64), "error": np.array("")}  # they come inside out


def _without_chance(library: str) -> bool:
    """Let a loaded library draw the same numbers in every process; False where the place is not found, as outside Linux.

    fTetWild shuffles its faces with a generator that it seeds from std::random_device, and offers no seed. The library reaches that function by an
    address in its own table, resolved when Python loads it; there it finds one that always gives the same number.
    """
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return False
    try:
        drawn = ctypes.cast(ctypes.CDLL("libstdc++.so.6")["_ZNSt13random_device9_M_getvalEv"], ctypes.c_void_p).value
    except (OSError, AttributeError):
        return False
    found = False
    for line in maps.read_text().splitlines():
        span, rights, *_, name = line.split()
        if Path(name).name != library or rights[0] != "r" or "x" in rights:
            continue
        first, last = (int(x, 16) for x in span.split("-"))
        words = np.ctypeslib.as_array((ctypes.c_uint64 * ((last - first) // 8)).from_address(first))
        for place in first + 8 * np.flatnonzero(words == drawn):
            page = int(place) & ~(mmap.PAGESIZE - 1)
            ctypes.CDLL(None).mprotect(ctypes.c_void_p(page), ctypes.c_size_t(mmap.PAGESIZE), mmap.PROT_READ | mmap.PROT_WRITE)
            ctypes.c_uint64.from_address(int(place)).value = ctypes.cast(_SAME, ctypes.c_void_p).value or 0
            found = True
    return found


def _limit_memory(gib: float) -> None:
    try:
        import resource
    except ImportError:  # not POSIX: the wall clock alone limits the child
        return
    limit = int(gib * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _end_with_parent(parent: int) -> None:
    """A mesher whose caller was killed must not go on for minutes (ctypes gives the lock free while gmsh runs)."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _run(gmsh: Any, job: dict[str, Any]) -> dict[str, Any]:
    options = {
        "General.Terminal": 0, "General.NumThreads": 1, "Mesh.MaxNumThreads1D": 1, "Mesh.MaxNumThreads2D": 1, "Mesh.MaxNumThreads3D": 1,
        "Mesh.RandomSeed": 1, "Mesh.MeshSizeFromCurvature": 0, "Mesh.OptimizeNetgen": 0, "Mesh.ElementOrder": 1,
    }  # fmt: skip
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
    gmsh.logger.start()
    kind = str(job["kind"])
    if kind == "brep":
        extra = _load_brep(gmsh, job)
        algorithm, extra["coarser"], extra["per_turn"] = _mesh_within_budget(gmsh, job)
    else:
        extra = _load_surface(gmsh, job)
        algorithm = _mesh_volume(gmsh, str(job["algorithm"]))
    done = ["hxt" if algorithm == HXT else "delaunay"]
    nodes, tets, tags = _tets(gmsh)
    if not len(tets):
        raise ValueError("gmsh filled no volume")
    worst = _worst(nodes, tets)
    for method in ("", "Netgen"):  # gmsh's own (swaps, smoothing) is quick, Netgen's thorough
        if worst >= float(job["good_deg"]):
            break
        gmsh.model.mesh.optimize(method, niter=1)
        better, kept, numbers = _tets(gmsh)
        if _worst(better, kept) > worst:
            nodes, tets, tags, worst = better, kept, numbers, _worst(better, kept)
            done.append(method.lower() or "gmsh")
    if kind == "brep":
        extra |= _boundary(gmsh, tags, is_curved=bool(job["per_turn"]))
    return {"nodes": nodes, "tets": tets, "tags": tags, "min_dihedral_deg": worst, "done": np.array("+".join(done)), "error": np.array(""), **extra}


def _mesh_within_budget(gmsh: Any, job: dict[str, Any]) -> tuple[int, float, float]:
    """Mesh faces and volume; again while over the budget: coarser, and where that did not do, round faces hold the size down, so with fewer edges
    round a circle (no fewer than half of those asked for). Returns the algorithm, how much coarser than asked, and the edges round a circle.
    """
    most, asked = float(job["max_size_mm"]) / float(job["size_mm"]), float(job["per_turn"])
    coarser, per_turn = 1.0, asked
    for last in (False, False, False, True):
        limit = _set_sizes(gmsh, float(job["size_mm"]) * coarser, NARROW_FACTOR * coarser, per_turn)
        if job.get("is_patched"):
            gmsh.option.setNumber("Mesh.MeshSizeMin", _least_size(gmsh, limit, per_turn))
        gmsh.model.mesh.generate(2)
        algorithm = _mesh_volume(gmsh, str(job["algorithm"]))
        nodes, tets, _ = _tets(gmsh)
        n_boundary = sum(len(t) for t in gmsh.model.mesh.getElements(2)[1])
        n_order_2 = 2 * len(nodes) + len(tets) + n_boundary // 2  # corners and edges; Euler on a ball: edges = nodes + tets + boundary / 2 - 1
        excess = max(n_order_2 / float(job["max_nodes"]), len(tets) / float(job["max_tets"]))
        fewer = coarser > 1 and per_turn > asked / 2
        if excess <= 1 or last or (coarser >= most and not fewer):
            break
        step = 1.03 * excess**0.5
        coarser, per_turn = (coarser, max(per_turn / step, asked / 2)) if fewer else (min(coarser * step, most), per_turn)
        gmsh.model.mesh.clear()
        for field in gmsh.model.mesh.field.list():
            gmsh.model.mesh.field.remove(field)
    return algorithm, coarser, per_turn


def _mesh_volume(gmsh: Any, name: str) -> int:
    algorithm = _algorithm(gmsh, name)
    gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
    gmsh.model.mesh.generate(3)
    return algorithm


def _algorithm(gmsh: Any, name: str) -> int:
    if name in ("hxt", "delaunay"):
        return HXT if name == "hxt" else DELAUNAY
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max()) + 1, np.int64)
    row[tags.astype(np.int64)] = np.arange(len(tags))
    triangles = row[gmsh.model.mesh.getElementsByType(2)[1].astype(np.int64).reshape(-1, 3)]
    smallest = float(np.degrees(triangle_angles(xyz.reshape(-1, 3), triangles).min()))
    if name == "other" and smallest < NEEDLE_DEG:
        raise ValueError("HXT is not tried on a surface of needles: it may take minutes")
    return HXT if smallest >= NEEDLE_DEG and name == "auto" else DELAUNAY


def _load_brep(gmsh: Any, job: dict[str, Any]) -> dict[str, Any]:
    """Read the STEP and move it to the origin."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solid.step"
        path.write_bytes(job["step"].tobytes())
        entities = gmsh.model.occ.importShapes(str(path), highestDimOnly=False)
    gmsh.model.occ.translate([e for e in entities if e[0] == 3], *(float(x) for x in job["shift_mm"]))
    gmsh.model.occ.synchronize()
    for name, value in {"Mesh.MeshSizeMin": 0.0, "Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0, "Mesh.Algorithm": 6}.items():
        gmsh.option.setNumber(name, value)
    faces = [tag for _, tag in gmsh.model.getEntities(2)]
    centre = np.array([gmsh.model.occ.getCenterOfMass(2, tag) for tag in faces]).reshape(-1, 3)
    area = np.array([gmsh.model.occ.getMass(2, tag) for tag in faces])
    return {"face_centre": centre, "face_area": area}


def _least_size(gmsh: Any, limit: Mapping[int, float], per_turn: float) -> float:
    """The smallest size that a face or curve asks for other than by the bends of NURBS patches: these follow noise, and where it is sharp would be
    filled with elements without end. limit : of each curve.
    """
    bends = [1e-300]
    for _, face in gmsh.model.getEntities(2):
        if gmsh.model.getType(2, face) not in ("Plane", *SPLINES):
            low, high = gmsh.model.getParametrizationBounds(2, face)
            middle = (np.asarray(low) + np.asarray(high)) / 2
            bends += np.abs(gmsh.model.getPrincipalCurvatures(face, middle)[:2]).ravel().tolist()
    true = [value for curve, value in limit.items() if gmsh.model.getType(1, curve) not in SPLINES]
    return min([*true, 2 * math.pi / (per_turn * max(bends))], default=0.0)


def _set_sizes(gmsh: Any, size: float, factor: float, per_turn: float) -> dict[int, float]:
    """Element size `size`, round a circle `per_turn` edges, but near narrow faces and short edges only `factor` times their width or length, growing
    back by GROWTH with distance.

    Without it a strip of width w beside elements of size h is filled with needles of w / h. Returns the size on each curve.
    """
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", per_turn)
    limit: dict[int, float] = {}
    for curve in gmsh.model.getEntities(1) if per_turn else []:  # as fine beside a round edge, or a straight one of a round face, as on it
        limit[curve[1]] = min(size, 2 * math.pi * _radius(gmsh, curve[1]) / per_turn)
    for face in gmsh.model.getEntities(2):
        curves = [tag for _, tag in gmsh.model.getBoundary([face], combined=False, oriented=False)]
        length = {tag: gmsh.model.occ.getMass(1, tag) for tag in curves}
        curves = [tag for tag in curves if length[tag] > 1e-9]  # the pole of a sphere is an edge without length
        width = 2 * gmsh.model.occ.getMass(*face) / sum(length.values())  # of a strip; of a triangle this is the inradius, a third of its height
        width *= 3.0 if len(curves) == 3 else 1.0
        for tag in curves:
            limit[tag] = min(limit.get(tag, size), factor * min(width, length[tag]))
    classes: dict[int, list[int]] = {}
    for tag, value in limit.items():
        if value < size:
            classes.setdefault(math.floor(2 * math.log2(value / size)), []).append(tag)
    fields = [_growing_field(gmsh, curves, min(limit[c] for c in curves), size) for _, curves in sorted(classes.items())]
    smallest = gmsh.model.mesh.field.add("Min")
    gmsh.model.mesh.field.setNumbers(smallest, "FieldsList", fields)
    gmsh.model.mesh.field.setAsBackgroundMesh(smallest)
    return limit


def _radius(gmsh: Any, curve: int) -> float:
    """The smallest radius of curvature at places along a curve, and of the faces that a straight one bounds; infinite where all are flat, or at the
    pole of a sphere.
    """
    if gmsh.model.occ.getMass(1, curve) < 1e-9:
        return math.inf
    low, high = gmsh.model.getParametrizationBounds(1, curve)
    places = np.linspace(float(low[0]), float(high[0]), 9)
    bend = float(np.abs(gmsh.model.getCurvature(1, curve, places)).max())
    if gmsh.model.getType(1, curve) == "Line":
        for face in gmsh.model.getAdjacencies(1, curve)[0].tolist():
            if gmsh.model.getType(2, face) != "Plane":  # not at its ends: a cone may end in its tip
                at = gmsh.model.reparametrizeOnSurface(1, curve, places[2:-2], face)
                bend = max(bend, float(np.abs(gmsh.model.getPrincipalCurvatures(face, at)[:2]).max()))
    return 1.0 / bend if math.isfinite(bend) and bend > 0 else math.inf


def _growing_field(gmsh: Any, curves: list[int], low: float, high: float) -> int:
    """Size `low` on the curves, growing to `high`. The distance is to places along the curves, set as close as the elements."""
    longest = max(gmsh.model.occ.getMass(1, c) for c in curves)
    distance, threshold = gmsh.model.mesh.field.add("Distance"), gmsh.model.mesh.field.add("Threshold")
    gmsh.model.mesh.field.setNumbers(distance, "CurvesList", curves)
    gmsh.model.mesh.field.setNumber(distance, "Sampling", min(10_000, max(20, math.ceil(longest / low))))
    for name, value in {"InField": distance, "SizeMin": low, "SizeMax": high, "DistMin": low / 2, "DistMax": low / 2 + (high - low) / GROWTH}.items():
        gmsh.model.mesh.field.setNumber(threshold, name, value)
    return int(threshold)


def _load_surface(gmsh: Any, job: dict[str, Any]) -> dict[str, Any]:
    """The triangles as they are; element size grows from them inward by `growth` metres per metre of distance."""
    vertices, faces = job["vertices"], job["faces"]
    surface = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, surface, np.arange(1, len(vertices) + 1), vertices.ravel())
    gmsh.model.mesh.addElementsByType(surface, 2, [], (faces + 1).ravel())
    gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
    gmsh.model.geo.synchronize()
    edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=2)
    reach = float(np.linalg.norm(np.ptp(vertices, axis=0))) / 2
    field = gmsh.model.mesh.field.add("Extend")
    gmsh.model.mesh.field.setNumbers(field, "SurfacesList", [surface])
    for name, value in {"DistMax": reach, "SizeMax": float(np.median(edges)) + float(job["growth"]) * reach, "Power": 1.0}.items():
        gmsh.model.mesh.field.setNumber(field, name, value)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    return {}


def _tets(gmsh: Any) -> tuple[FloatArray, IntArray, IntArray]:
    """Nodes of the tets in ascending order of gmsh's numbers, tets by row, and those numbers."""
    tets = gmsh.model.mesh.getElementsByType(4)[1].astype(np.int64).reshape(-1, 4)
    used, rows = np.unique(tets, return_inverse=True)
    return _places(gmsh, used), rows.reshape(-1, 4).astype(np.int64), used


def _worst(nodes: FloatArray, tets: IntArray) -> float:
    return float(tet_dihedrals(nodes, tets).min()) if len(tets) else 0.0


def _boundary(gmsh: Any, used: IntArray, *, is_curved: bool) -> dict[str, Any]:
    faces = [tag for _, tag in gmsh.model.getEntities(2)]
    by_face = [gmsh.model.mesh.getElementsByType(2, tag)[1].astype(np.int64).reshape(-1, 3) for tag in faces]
    triangles = np.concatenate(by_face)
    face = np.repeat(np.arange(len(faces)), [len(t) for t in by_face])
    found = {"triangles": np.searchsorted(used, triangles), "face": face}
    if not is_curved:
        return found
    corners = _places(gmsh, triangles)
    gmsh.model.mesh.setOrder(2)  # only to see where the middles of the edges are; nodes are renumbered, triangles are not
    places = _places(gmsh, np.concatenate([gmsh.model.mesh.getElementsByType(9, tag)[1].astype(np.int64).reshape(-1, 6) for tag in faces]))
    if not np.array_equal(corners, places[:, :3]):
        raise ValueError("the triangles changed when their middles were asked for")
    return {**found, "middles": places[:, [3, 4, 5]]}


def _places(gmsh: Any, numbers: IntArray) -> FloatArray:
    """(..., 3) of nodes by gmsh's numbers."""
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    return np.asarray(xyz.reshape(-1, 3)[order[np.searchsorted(tags[order].astype(np.int64), numbers)]])


if __name__ == "__main__":
    main(*sys.argv[1:3])
