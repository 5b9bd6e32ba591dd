"""Chapter 2, second half: network layers, clustering, splines, tessellation, edges, bad elements, relaxation (figures 2.11 to 2.20)."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial import Delaunay, Voronoi

from scan2fea.kernel.nurbs import basis, uniform_knots
from scan2fea.kernel.quality import TET_LIMITS, tet_quality, triangle_quality
from scan2fea.kernel.topology import edge_table, half_edges
from scan2fea.remeshing.lloyd import lloyd
from scan2fea.report.colours import categories, viridis
from scan2fea.segmentation import METHODS, SegmentationOptions
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.control_sets import CONTROL_SETS
from scan2fea.thesis.background import block
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.canvas import BLUE, FAINT, GREEN, INK, ORANGE, RED, Canvas
from scan2fea.thesis.chain import advancing_front_mesh
from scan2fea.thesis.clouds import METRES_PER_INCH
from scan2fea.thesis.experiment import Made, Table
from scan2fea.types import FloatArray, IntArray, PointCloud, TriangleMesh


def activations(bench: Bench) -> Made:
    """Figure 2.11: the usual activation functions."""
    x = np.linspace(-4, 4, 201)
    shown = (("tanh", np.tanh(x), (-1.2, 1.2)), ("sigmoid", 1 / (1 + np.exp(-x)), (-0.2, 1.2)), ("rectifier", np.maximum(x, 0), (-0.5, 4.2)))
    canvas = Canvas(930, 300)
    for k, (name, y, span) in enumerate(shown):
        panel = canvas.panel((50 + 310 * k, 50, 290 + 310 * k, 250), (-4, 4), span, name)
        panel.axes("x", "")
        panel.line([(-4, 0), (4, 0)], FAINT, 1)
        panel.line(np.c_[x, y], BLUE, 2)
    return Made(picture=canvas.png(), says=("Closed forms: tanh x, 1 / (1 + exp(-x)), max(x, 0).",))


def hierarchies(bench: Bench) -> Made:
    """Figure 2.13: divisive against agglomerative clustering."""
    canvas, says = Canvas(900, 640), []
    for row, name in enumerate(("lines", "uneven")):
        points, truth = CONTROL_SETS[name](120, bench.options.seed)
        k = int(truth.max()) + 1
        for column, method in enumerate(("divisive", "agglomerative")):
            found = METHODS[method](PointCloud.of(points), SegmentationOptions(method=method, clusters=k, min_points=3, supports=False))
            low, high = points[:, :2].min(axis=0) - 0.2, points[:, :2].max(axis=0) + 0.2
            box = (20 + 450 * column, 40 + 320 * row, 440 + 450 * column, 310 + 320 * row)
            panel = canvas.panel(box, (low[0], high[0]), (low[1], high[1]), f"{method}, {k} clusters", equal=True)
            panel.dots(points[:, :2], categories(found), 2.6)
            says.append(f"{name}, {method}: adjusted Rand index {agreement(truth, found).adjusted_rand:.2f}.")
    says.append("Divisive splits the widest cluster, agglomerative (single linkage) joins the two nearest.")
    return Made(picture=canvas.png(), says=tuple(says))


def spline(bench: Bench) -> Made:
    """Figure 2.16: a NURBS curve, its control points and their polygon (eq 2.16 to 2.18)."""
    control = np.array([(0.0, 0.0), (1.0, 2.2), (2.4, 2.6), (3.2, 0.2), (4.6, -0.4), (5.6, 1.9), (7.0, 1.2)])
    knots, u = uniform_knots(len(control), 3), np.linspace(0, 1, 301)
    b = basis(knots, 3, u)
    canvas = Canvas(760, 380)
    panel = canvas.panel((40, 40, 740, 340), (-0.4, 7.4), (-1.0, 3.2), "Cubic NURBS curve", equal=True)
    panel.line(control, INK, 1)
    for weight, colour in ((1.0, BLUE), (4.0, ORANGE)):
        w = np.ones(len(control))
        w[2] = weight
        panel.line((b * w) @ control / (b @ w)[:, None], colour, 2.2)
    panel.dots(control, GREEN, 5)
    total = float(np.abs(b.sum(axis=1) - 1).max())
    says = (
        f"Blue: all weights 1; orange: the third weight is 4. The basis functions sum to 1 within {total:.0e}.",
        "The curve meets the first and last control point alone: control points are not interpolated, as the thesis's wording has it.",
    )
    return Made(picture=canvas.png(), says=says)


def tessellation(bench: Bench) -> Made:
    """Figure 2.17: Voronoi cells (eq 2.19) and the Delaunay triangles dual to them."""
    points = np.random.default_rng(bench.options.seed + 3).random((24, 2))
    cells, triangles = Voronoi(points), Delaunay(points)
    canvas = Canvas(930, 340)
    for k, title in enumerate(("points", "Voronoi cells", "Delaunay triangles")):
        panel = canvas.panel((15 + 310 * k, 40, 300 + 310 * k, 325), (0, 1), (0, 1), title, equal=True)
        if k == 1:
            for a, b in cells.ridge_vertices:
                if a >= 0 and b >= 0 and np.abs(cells.vertices[[a, b]] - 0.5).max() < 0.5:
                    panel.line(cells.vertices[[a, b]], ORANGE, 1.5)
        if k == 2:
            for simplex in triangles.simplices:
                panel.line(points[simplex], INK, 1.2, closed=True)
        panel.dots(points, BLUE, 3.5)
    says = f"{len(points)} points, {len(triangles.simplices)} triangles; cells that leave the square are not drawn."
    return Made(picture=canvas.png(), says=(says,))


def half_edge(bench: Bench) -> Made:
    """Figure 2.18: edges of one face only, in blue, on an advancing front mesh with holes cut into it."""
    pitch = METRES_PER_INCH
    _, points = block(pitch, bench.options.seed)
    mesh = advancing_front_mesh(points, bench.options.seed)
    centre = points[[len(points) // 7, len(points) // 2, 6 * len(points) // 7]]
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    drop = (np.linalg.norm(middle[:, None] - centre[None], axis=2) < 2 * pitch).any(axis=1)
    mesh = dataclasses.replace(mesh, faces=mesh.faces[~drop])
    table = edge_table(mesh.faces)
    is_half = table.count == 1
    turn = np.array([[0.8, -0.6, 0.0], [0.25, 0.33, 0.91]])
    flat = mesh.vertices @ turn.T
    toward = np.cross(turn[0], turn[1])
    tri = mesh.vertices[mesh.faces]
    faces_us = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]) @ toward > 0
    canvas = Canvas(700, 480)
    low, high = flat.min(axis=0), flat.max(axis=0)
    panel = canvas.panel((20, 40, 680, 465), (low[0], high[0]), (low[1], high[1]), "Half edges in blue", equal=True)
    shown = np.unique(table.edge_of.reshape(-1, 3)[faces_us])
    for e in shown[~is_half[shown]].tolist():
        panel.line(flat[table.edges[e]], FAINT, 1)
    for e in np.flatnonzero(is_half).tolist():
        panel.line(flat[table.edges[e]], BLUE, 2.6)
    says = (
        f"{len(half_edges(mesh.faces)) - int(is_half.sum())} sides of triangles have a partner, {int(is_half.sum())} have none: these border "
        "holes."
    )
    return Made(picture=canvas.png(), says=(says,))


_TRIANGLES = {
    "equilateral": [(0, 0), (1, 0), (0.5, 3**0.5 / 2)],
    "needle": [(0, 0), (1, 0), (1, 0.05)],
    "cap": [(0, 0), (1, 0), (0.5, 0.03)],
}
_TETS = {
    "regular": [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)],
    "sliver": [(1, 0, 0.03), (0, 1, -0.03), (-1, 0, 0.03), (0, -1, -0.03)],
    "wedge": [(0, 0, 0), (1, 0, 0), (0.5, 1, 0), (0.5, 1, 0.06)],
    "spire": [(0, 0, 0), (0.06, 0, 0), (0.03, 0.06, 0), (0.03, 0.02, 1)],
    "cap": [(0, 0, 0), (1, 0, 0), (0.5, 0.9, 0), (0.5, 0.3, 0.04)],
}
_NAMES = ("Q1", "Q2", "Q2_corrected", "Q3", "Q4", "Q5")


def bad_elements(bench: Bench) -> Made:
    """Figure 2.19 and table 2.1: measures of quality on good and bad triangles and tets."""
    rows: list[tuple[str | float, ...]] = []
    canvas = Canvas(1120, 330)
    every: list[tuple[str, FloatArray]] = [(f"{name} triangle", np.c_[np.array(p, float), np.zeros(3)]) for name, p in _TRIANGLES.items()]
    every += [(f"{name} tet", np.array(p, float)) for name, p in _TETS.items()]
    for k, (name, p) in enumerate(every):
        corner: IntArray = np.arange(len(p))[None]
        if len(p) == 4 and np.linalg.det(p[1:] - p[0]) < 0:
            p = p[[0, 2, 1, 3]]
        found = triangle_quality(p, corner) if len(p) == 3 else tet_quality(p, corner)
        rows.append((name, *(float(found[q][0]) for q in _NAMES)))
        flat = p @ np.array([[0.9, -0.44, 0.0], [0.22, 0.45, 0.87]]).T if len(p) == 4 else p[:, :2]
        centre, half = (flat.max(axis=0) + flat.min(axis=0)) / 2, float(np.ptp(flat, axis=0).max()) * 0.6
        box = (10 + 140 * k, 40, 130 + 140 * k, 160)
        panel = canvas.panel(box, (centre[0] - half, centre[0] + half), (centre[1] - half, centre[1] + half), name, equal=True)
        for i in range(len(p)):
            for j in range(i):
                panel.line(flat[[i, j]], INK, 1.6)
        panel.dots(flat, RED, 3)
        for line, q in enumerate(("Q1", "Q2", "Q3", "Q4", "Q5")):
            canvas.words((20 + 140 * k, 175 + 22 * line), f"{q} = {float(found[q][0]):.4f}", 13, "lt")
    says = (
        "Q2 = r / lmin as printed grows for needles (its supremum is 0.5): no quality; corrected, r / lmax.",
        f"Best values of a tet: {', '.join(f'{q} {TET_LIMITS[q].best:.4f}' for q in _NAMES)}. Q4 is blind to caps and slivers.",
    )
    return Made(picture=canvas.png(), table=Table(head=("element", *_NAMES), rows=tuple(rows)), says=says)


def relaxation(bench: Bench) -> Made:
    """Figure 2.20: Lloyd's relaxation after 1, 5, 10 and 15 iterations."""
    start = square(bench.options.seed)
    canvas, says = Canvas(1060, 330), []
    for k, iterations in enumerate((0, 1, 5, 10, 15)):
        mesh, found = (start, None) if iterations == 0 else lloyd(start, iterations, constrained=True)
        shape = np.asarray(triangle_quality(mesh.vertices, mesh.faces)["radius_ratio"])
        panel = canvas.panel((8 + 210 * k, 40, 203 + 210 * k, 235), (0, 1), (0, 1), f"{iterations} iterations", equal=True)
        for face, colour in zip(mesh.faces, viridis(shape).tolist(), strict=True):
            panel.polygon(mesh.vertices[face][:, :2], tuple(colour), INK)
        canvas.words((105 + 210 * k, 250), f"least 2 r / R {shape.min():.3f}", 13)
        canvas.words((105 + 210 * k, 270), f"median {np.median(shape):.3f}", 13)
        if found is not None:
            says.append(f"after {found.iterations}: energy {100 * found.energies[-1] / found.energies[0]:.1f} % of the first")
    return Made(picture=canvas.png(), says=("; ".join(says) + ".", "Border vertices slide along the border; corners stay."))


def square(seed: int) -> TriangleMesh:
    """A square of triangles with 90 vertices at random inside and 40 on its border."""
    rng = np.random.default_rng(seed)
    side = np.linspace(0, 1, 11)[:-1]
    rim = np.concatenate([np.c_[side, 0 * side], np.c_[1 + 0 * side, side], np.c_[1 - side, 1 + 0 * side], np.c_[0 * side, 1 - side]])
    points = np.concatenate([rim, 0.04 + 0.92 * rng.random((90, 2))])
    return TriangleMesh(vertices=np.c_[points, np.zeros(len(points))], faces=_turned(points, Delaunay(points).simplices.astype(np.int64)))


def _turned(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces counter-clockwise."""
    tri = points[faces]
    a, b = tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]
    clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
    out = faces.copy()
    out[clockwise] = out[clockwise][:, [0, 2, 1]]
    return out
