"""The pictures of one object's tetrahedra: a cut, how it bends under its own weight, how it swings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.quality import TET_FACES, TET_LIMITS, scaled_jacobian, tet_dihedrals
from scan2fea.report.camera import Camera, framed
from scan2fea.report.charts import Limit, colour_bar, histogram, nice_step
from scan2fea.report.colours import VIRIDIS, gradient, viridis
from scan2fea.report.figures import DATA_CONTRAST, Figure, drawn
from scan2fea.report.markup import Html
from scan2fea.report.render import Shape, render
from scan2fea.report.words import number
from scan2fea.types import BoolArray, FloatArray, IntArray, Value
from scan2fea.units import MILLIMETRES_PER_METRE

WARP = 0.07  # of the size of the object: how far its most displaced point is shown to move
SLENDER = 4.0  # length / width above which the cut goes across and the picture shows its neighbourhood only
NEAR_CUT = 1.1  # of the width: how much of a slender thing is shown behind the cut
WORST_COLOUR = np.array([204, 51, 38], np.uint8)
BEST_DIHEDRAL = TET_LIMITS["min_dihedral_deg"].best


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid(Value):
    """The tetrahedra of volume.vtu. nodes : (n, 3).   tets : (m, 4 or 10).   point_data, cell_data : arrays by name."""

    nodes: FloatArray
    tets: IntArray
    point_data: Mapping[str, FloatArray]
    cell_data: Mapping[str, FloatArray]

    def min_dihedral_deg(self) -> FloatArray:
        """(m,) the smallest angle between two faces of each tet: as recorded, else computed."""
        recorded = self.cell_data.get("min_dihedral_deg")
        return tet_dihedrals(self.nodes, self.tets).min(axis=1) if recorded is None else np.asarray(recorded, float).reshape(-1)

    def scaled_jacobian(self) -> FloatArray:
        recorded = self.cell_data.get("scaled_jacobian")
        return scaled_jacobian(self.nodes, self.tets) if recorded is None else np.asarray(recorded, float).reshape(-1)

    def boundary(self, kept: BoolArray | None = None) -> tuple[IntArray, IntArray]:
        """(k, 3) outward faces that only one of the kept tets has, and (k,) the tet of each."""
        rows = np.arange(len(self.tets)) if kept is None else np.flatnonzero(kept)
        faces = self.tets[rows][:, TET_FACES].reshape(-1, 3)
        low, middle, high = np.sort(faces, axis=1).T
        key = (low * len(self.nodes) + middle) * len(self.nodes) + high  # below 2**63 up to two million nodes
        _, first, uses = np.unique(key, return_index=True, return_counts=True)
        once = np.sort(first[uses == 1])
        return faces[once], rows[once // 4]


def cut_figure(solid: Solid, camera: Camera) -> Figure:
    """The tets on the far side of a plane through the middle, coloured by their smallest dihedral angle."""
    centre = solid.nodes[solid.tets[:, :4]].mean(axis=1)
    normal, across, width = _cut(solid.nodes[np.unique(solid.tets[:, :4])], camera)
    along = centre @ normal
    depth = along - np.median(along)  # half of the elements on either side, wherever the material is
    kept = depth <= 0
    view = camera
    if across:
        kept &= depth > -NEAR_CUT * width
        view = _facing(solid.nodes[np.unique(solid.tets[kept][:, :4])], normal, camera)
    faces, owner = solid.boundary(kept)
    angle = solid.min_dihedral_deg()
    shape = Shape(vertices=solid.nodes, faces=faces, colours=viridis(angle[owner] / BEST_DIHEDRAL), smooth=False, lines=True, contrast=DATA_CONTRAST)
    legend = colour_bar(
        gradient(VIRIDIS), "0\u00b0 (flat)", "", f"{number(BEST_DIHEDRAL, 3)}\u00b0 (regular)", "Smallest dihedral angle of each element"
    )
    caption = f"{'Cut across the middle, the part behind it shown' if across else 'Cut through the middle'}: {len(solid.tets):,} tetrahedra in all."
    alt = f"The tetrahedra behind a plane through the middle; smallest dihedral angle {number(float(angle.min()))} degrees."
    return drawn("Inside the mesh", alt, caption, view, render(view, (shape,)), legend)


def worst_figure(solid: Solid, camera: Camera) -> Figure:
    """The worst element and, of those that touch it, the ones behind it: what its neighbours look like."""
    angle = solid.min_dihedral_deg()
    worst = int(angle.argmin())
    touches = np.isin(solid.tets[:, :4], solid.tets[worst, :4]).any(axis=1)
    depth = solid.nodes[solid.tets[:, :4]].mean(axis=1) @ camera.axes[2]
    kept = touches & (depth < depth[worst])
    kept[worst] = True
    near = solid.nodes[np.unique(solid.tets[kept][:, :4])]
    view = framed(near, camera.axes, camera.width_px, round(camera.width_px * 0.64))
    faces, owner = solid.boundary(kept)
    colours = viridis(angle[owner] / BEST_DIHEDRAL)
    colours[owner == worst] = WORST_COLOUR
    shape = Shape(vertices=solid.nodes, faces=faces, colours=colours, smooth=False, lines=True, contrast=DATA_CONTRAST)
    least = number(float(angle[worst]))
    legend = colour_bar(
        gradient(VIRIDIS), "0\u00b0 (flat)", "", f"{number(BEST_DIHEDRAL, 3)}\u00b0 (regular)", "Smallest dihedral angle of each element"
    )
    caption = f"Element {worst + 1:,} in red, {least}\u00b0; behind it the {int(kept.sum()) - 1} elements that touch it there."
    return drawn("The worst element", f"The worst element, {least} degrees, and its neighbours.", caption, view, render(view, (shape,)), legend)


def displacement_figure(solid: Solid, camera: Camera) -> Figure | None:
    """The self-weight case: warped by a stated factor, coloured by how far each point moves."""
    moved = _vectors(solid, "displacement_m")
    if moved is None:
        return None
    size = np.linalg.norm(moved, axis=1)
    largest = float(size.max())
    if not largest > 0:
        return None
    factor = _round_factor(WARP * _extent(solid.nodes) / largest)
    top = number(largest * MILLIMETRES_PER_METRE)
    legend = colour_bar(gradient(VIRIDIS), "0", "", f"{top} mm", "Displacement under its own weight")
    caption = f"Drawn with the displacement enlarged {number(factor)} times."
    alt = f"Warped shape under its own weight, largest displacement {top} mm, drawn {number(factor)} times larger."
    warped = _warped(solid, moved * factor, size / largest)
    view = _holding(warped, camera)
    return drawn("Self weight", alt, caption, view, render(view, (warped,)), legend)


def mode_figure(solid: Solid, camera: Camera, k: int, frequency_hz: float | None) -> Figure | None:
    """The k-th elastic mode (from 1) of those recorded, warped to a visible size, coloured by relative amplitude."""
    names = sorted((int(name[5:]), name) for name in solid.point_data if name.startswith("mode_") and name[5:].isdigit())
    shape = _vectors(solid, names[k - 1][1]) if k <= len(names) else None
    if shape is None:
        return None
    size = np.linalg.norm(shape, axis=1)
    largest = float(size.max())
    if not largest > 0:
        return None
    told = f"Mode {k}" + (f", {number(frequency_hz)} Hz" if frequency_hz is not None else "")
    legend = colour_bar(gradient(VIRIDIS), "0 (still)", "", "1 (moves most)", "Relative amplitude")
    warped = _warped(solid, shape * (WARP * _extent(solid.nodes) / largest), size / largest)
    view = _holding(warped, camera)
    caption = "Free in space; the amplitude of a mode has no unit."
    return drawn(told, f"{told}: warped shape of the free body.", caption, view, render(view, (warped,)), legend)


def quality_charts(solid: Solid) -> tuple[Html, Html]:
    """Histograms of the smallest dihedral angle and of the scaled Jacobian, with the limits of solvers."""
    angle, jacobian = TET_LIMITS["min_dihedral_deg"], TET_LIMITS["scaled_jacobian"]
    return (
        histogram(
            solid.min_dihedral_deg(),
            low=0.0,
            high=75.0,
            axis="smallest dihedral angle, degrees",
            title="Shape of the elements",
            limits=_limits(angle.fail, angle.warn),
            palette=lambda share: viridis(share * 75.0 / BEST_DIHEDRAL),
        ),
        histogram(
            solid.scaled_jacobian(),
            low=-0.05,
            high=1.0,
            axis="scaled Jacobian",
            title="Scaled Jacobian",
            limits=_limits(jacobian.fail, jacobian.warn),
        ),
    )


def worst_elements(solid: Solid, n: int = 5) -> list[tuple[int, float, FloatArray]]:
    """Number (from 1), smallest dihedral angle and centroid of the n worst tets."""
    angle = solid.min_dihedral_deg()
    rows = np.argsort(angle, kind="stable")[:n]
    return [(int(row) + 1, float(angle[row]), solid.nodes[solid.tets[row, :4]].mean(axis=0)) for row in rows]


def _limits(fail: float | None, warn: float | None) -> tuple[Limit, ...]:
    given = [(fail, "fails"), (warn, "warns")]
    return tuple(Limit(at=at, label=f"{label} {number(at)}") for at, label in given if at is not None)


def _cut(points: FloatArray, camera: Camera) -> tuple[FloatArray, bool, float]:
    """Normal of the cutting plane (towards the viewer), whether it goes across a slender thing, and the width of that thing."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    extent = np.ptp(centred @ axes.T, axis=0)
    towards = camera.axes[2]
    across = bool(extent[0] > SLENDER * extent[1])
    sensible = axes[:2] if extent[1] > SLENDER * extent[2] else axes  # a plate is cut through its thickness, not along its middle plane
    normal = axes[0] if across else sensible[int(np.argmax(np.abs(sensible @ towards)))]
    return normal * (1.0 if normal @ towards >= 0 else -1.0), across, float(extent[1])


def _facing(points: FloatArray, normal: FloatArray, camera: Camera) -> Camera:
    """A view on the cut itself, a little from the side so that depth shows; up is the up of the other pictures."""
    up = camera.axes[1] - (camera.axes[1] @ normal) * normal
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else camera.axes[0]
    towards = normal + 0.45 * np.cross(up, normal) + 0.35 * up
    towards = towards / np.linalg.norm(towards)
    right = np.cross(up, towards)
    right = right / np.linalg.norm(right)
    return framed(points, np.stack([right, np.cross(towards, right), towards]), camera.width_px, round(camera.width_px * 0.64))


def _vectors(solid: Solid, name: str) -> FloatArray | None:
    """(n, 3) finite vectors at the nodes, or None."""
    values = solid.point_data.get(name)
    if values is None or values.shape != solid.nodes.shape or not np.isfinite(values).all():
        return None
    return values


def _warped(solid: Solid, shift: FloatArray, share: FloatArray) -> Shape:
    faces, _ = solid.boundary()
    return Shape(vertices=solid.nodes + shift, faces=faces, colours=viridis(share), per_vertex=True, contrast=DATA_CONTRAST)


def _holding(warped: Shape, camera: Camera) -> Camera:
    """The same view, drawn back where the warped shape would leave the picture."""
    at = camera.project(warped.vertices[np.unique(warped.faces)])
    inside = (at[:, 0] >= 0) & (at[:, 0] <= camera.width_px) & (at[:, 1] >= 0) & (at[:, 1] <= camera.height_px)
    if inside.all():
        return camera
    tallest = round(0.64 * camera.width_px)
    return framed(warped.vertices, camera.axes, camera.width_px, max(tallest, camera.height_px), least_height_px=camera.height_px)


def _extent(nodes: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(nodes, axis=0)))


def _round_factor(factor: float) -> float:
    """The next 1, 2 or 5 times a power of ten not above `factor`."""
    step = nice_step(factor, 1)
    return step if step <= factor * (1 + 1e-9) else nice_step(factor / 2.5, 1)
