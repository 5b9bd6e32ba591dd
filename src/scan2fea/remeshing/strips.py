"""Narrow planes: the edge of a plate, where one or two rows of points lie between its two sides.

Such a strip is too narrow to show a normal of its own. It is taken to stand square on the plate (reference/reconstruction.md, pitfalls:
"close support ends with a perpendicular strip"), and only its direction in the plate's plane and its offset are read from the points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.topology import face_components, vertex_faces
from scan2fea.remeshing.planes import Labelled, Neighbours, Scale
from scan2fea.remeshing.regions import planes_around
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

OPPOSITE = -0.94  # cosine between the outward normals of a plate's two sides
NARROW = 4.0  # spacings: wider edges show a normal of their own
BINS = 36  # directions round the plate's normal
CONE_DEG = 40.0  # faces of one strip look within this of its direction
LONG = 3.0  # spacings of the shortest strip
MOST = 24  # strips round one plate
UNSURE = 0.2  # radians: how far a likely direction may be from that of a strip without points of its own
BRIDGES = 4  # rounds; the last gives up and leaves free form
SQUARE = 0.2  # cosine: a strip stands square on its plate
MISALIGNED = 0.05  # radians that the mean normal of a strip may be off
INSIDE = 0.3  # of the thickness: a vertex this far from both sides is one of the strip's own


def narrow_planes(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """The labels with strips added that lie between two opposite planes nearer than NARROW spacings to each other."""
    label = labelled.label
    free = np.flatnonzero(label < 0)
    if not len(free) or len(labelled.offset) < 2:
        return labelled
    part = np.full(len(label), -1, np.int64)
    part[free] = face_components(mesh.faces[free])[1]
    around = planes_around(label, neighbours.of, part, len(labelled.offset))
    found: list[tuple[IntArray, Plane]] = []
    taken = label >= 0
    for a, b in _plates(labelled, scale):
        rows = free[~taken[free] & (around[part[free], a] & around[part[free], b])]
        rows = rows[_between(mesh, rows, labelled.plane(a), labelled.plane(b), scale)]
        sides = mesh.vertices[mesh.faces[(label == a) | (label == b)]].mean(1)
        plate = _Plate(labelled.plane(a), labelled.plane(b), labelled.normal, sides)
        for strip, plane in _strips(mesh, neighbours, rows, plate, scale):
            if len(strip):  # a strip may lose its last face to a stronger one
                taken[strip] = True
                found.append((strip, plane))
    return _with_strips(mesh, neighbours, labelled, found, scale)


def _plates(labelled: Labelled, scale: Scale) -> list[tuple[int, int]]:
    """Pairs of planes that look away from each other, less than NARROW spacings apart."""
    pairs = []
    for a in range(len(labelled.offset)):
        for b in range(a + 1, len(labelled.offset)):
            thickness = labelled.offset[a] + labelled.offset[b]  # n.x = a and -n.x = b bound a plate if a + b > 0
            if labelled.normal[a] @ labelled.normal[b] < OPPOSITE and 0 < thickness < NARROW * scale.spacing_m:
                pairs.append((a, b))
    return pairs


def _with_strips(
    mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, found: list[tuple[IntArray, Plane]], scale: Scale
) -> Labelled:
    """The labels with the strips added; strips in one plane (the ends of the legs of one section) share it, largest first."""
    label = labelled.label.copy()
    normals, offsets, weights = list(labelled.normal), list(labelled.offset), [0.0] * len(labelled.offset)
    first = len(offsets)
    for strip, plane in sorted(found, key=lambda item: (-len(item[0]), int(item[0][0]))):
        points, area = mesh.vertices[np.unique(mesh.faces[strip])], float(neighbours.areas[strip].sum())
        same = next((k for k in range(first, len(offsets)) if plane.normal @ normals[k] > np.cos(UNSURE / 2)
                     and abs(float(np.median(points @ normals[k])) - offsets[k]) < scale.strip_m), None)  # fmt: skip
        if same is None:
            label[strip] = len(offsets)
            normals.append(plane.normal)
            offsets.append(plane.offset)
            weights.append(area)
        else:
            label[strip] = same
            height = float(np.median(points @ normals[same]))
            offsets[same] = (offsets[same] * weights[same] + height * area) / (weights[same] + area)
            weights[same] += area
    loose = np.concatenate([labelled.loose, np.full(len(offsets) - first, scale.strip_m)])
    return Labelled(label=label, normal=np.array(normals).reshape(-1, 3), offset=np.array(offsets), loose=loose)


def bridged(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Where the two sides of a plate share a vertex (a knife edge or a notch in the reconstruction), the faces round it given to the strip that
    runs there; to free form if there is none.
    """
    label = labelled.label.copy()
    centre = mesh.vertices[mesh.faces].mean(1)
    start, faces_of = vertex_faces(mesh.faces, len(mesh.vertices))
    opposite = labelled.normal @ labelled.normal.T < OPPOSITE
    square = np.abs(labelled.normal @ labelled.normal.T) < SQUARE
    for attempt in range(BRIDGES):
        _fill_gaps(mesh, neighbours, labelled, label, scale)
        changed = False
        for v in _between_sides(mesh, label, opposite):
            around = faces_of[start[v] : start[v + 1]]
            names = np.unique(label[around])
            names = names[names >= 0]
            sides = np.flatnonzero(opposite[np.ix_(names, names)].any(1))
            if not len(sides):
                continue
            gap = np.where(square[names[sides[0]]], np.abs(labelled.normal @ mesh.vertices[v] - labelled.offset), np.inf)
            strip = int(gap.argmin())
            near = around[np.isin(label[around], [-1, *names[sides]])]
            if gap[strip] <= scale.reach_m and attempt < BRIDGES - 1:
                near = near[np.abs(centre[near] @ labelled.normal[strip] - labelled.offset[strip]) <= scale.reach_m]
                label[near] = strip
            else:
                label[near] = -1
            changed = changed or len(near) > 0
        if not changed:
            break
    return replace(labelled, label=label)


def _between_sides(mesh: TriangleMesh, label: IntArray, opposite: BoolArray) -> IntArray:
    """Vertices that touch two planes that look away from each other."""
    own = np.repeat(label, 3)
    low, high = np.full(len(mesh.vertices), np.iinfo(np.int64).max), np.full(len(mesh.vertices), -1)
    np.minimum.at(low, mesh.faces.ravel(), np.where(own < 0, np.iinfo(np.int64).max, own))
    np.maximum.at(high, mesh.faces.ravel(), own)
    mixed = np.flatnonzero((low < high)[mesh.faces.ravel()] & (own >= 0))
    key = np.unique(mesh.faces.ravel()[mixed] * len(opposite) + own[mixed])
    pairs = np.stack([key // max(len(opposite), 1), key % max(len(opposite), 1)], axis=1)
    found = []
    for step in (1, 2, 3):  # a vertex with more than four planes is met again when the first are settled
        same = np.flatnonzero(pairs[:-step, 0] == pairs[step:, 0])
        found.append(pairs[same, 0][opposite[pairs[same, 1], pairs[same + step, 1]]])
    return np.unique(np.concatenate(found))


def _fill_gaps(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, label: IntArray, scale: Scale) -> None:
    """Free parts next to a strip that lie wholly within reach of it become part of it; `label` is changed."""
    free = np.flatnonzero(label < 0)
    if not len(free):
        return
    is_strip = labelled.loose >= scale.strip_m
    n_parts, part = face_components(mesh.faces[free])
    for number in range(n_parts):
        rows = free[part == number]
        beside = np.unique(label[neighbours.of[rows]])
        beside = beside[beside >= 0]
        points = mesh.vertices[np.unique(mesh.faces[rows])]
        for strip in beside[is_strip[beside]]:
            if np.abs(points @ labelled.normal[strip] - labelled.offset[strip]).max() <= scale.reach_m:
                label[rows] = strip
                break


class _Plate:
    """The two sides of a plate, and the directions in its plane that other planes make likely for its edges."""

    def __init__(self, a: Plane, b: Plane, normals: FloatArray, sides: FloatArray) -> None:
        self.a, self.b, self.sides = a, b, sides
        self.across = (a.normal - b.normal) / np.linalg.norm(a.normal - b.normal)
        self.thickness = a.offset + b.offset
        flat = normals - (normals @ self.across)[:, None] * self.across
        size = np.linalg.norm(flat, axis=1)
        flat = flat[size > 0.9] / size[size > 0.9, None]
        both = np.concatenate([flat, np.cross(self.across, flat)])
        self.likely = np.concatenate([both, -both])

    def ends_at(self, plane: Plane, strip: FloatArray, reach: float) -> bool:
        """Do the sides near the points of a strip lie behind it? Else it bounds a notch, or nothing."""
        along = np.cross(self.across, plane.normal)
        low, high = np.percentile(strip @ along, [5, 95])
        near = self.sides[(self.sides @ along >= low) & (self.sides @ along <= high) & (np.abs(plane.distance(self.sides)) < reach)]
        return bool(len(near) and (plane.distance(near) < 0).mean() > 0.75)


def _between(mesh: TriangleMesh, rows: IntArray, a: Plane, b: Plane, scale: Scale) -> BoolArray:
    """Which faces lie between the two sides, all corners within the noise of the plate."""
    corners = mesh.vertices[mesh.faces[rows]]
    loose = 2 * scale.tolerance_m + 0.1 * scale.spacing_m
    return np.asarray(((a.distance(corners) < loose) & (b.distance(corners) < loose)).all(1))


def _strips(
    mesh: TriangleMesh, neighbours: Neighbours, rows: IntArray, plate: _Plate, scale: Scale
) -> list[tuple[IntArray, Plane]]:
    """The strips among the faces `rows` between the sides of a plate, most area first."""
    across = plate.across
    first = Plane(normal=across, offset=0.0).axes()
    centre = mesh.vertices[mesh.faces].mean(1)
    found: list[tuple[IntArray, Plane]] = []
    left = rows
    for _ in range(MOST):
        if len(left) < 4:
            break
        flat = neighbours.normals[left] @ first.T * neighbours.areas[left, None]
        angle = np.arctan2(flat[:, 1], flat[:, 0])
        weight = np.linalg.norm(flat, axis=1)
        histogram = np.bincount(((angle + np.pi) / (2 * np.pi) * BINS).astype(np.int64) % BINS, weights=weight, minlength=BINS)
        smoothed = histogram + 0.7 * (np.roll(histogram, 1) + np.roll(histogram, -1))
        peak = (smoothed.argmax() + 0.5) / BINS * 2 * np.pi - np.pi
        near = np.abs((angle - peak + np.pi) % (2 * np.pi) - np.pi) < np.radians(CONE_DEG)
        cone = left[near]
        if not len(cone):
            break
        total = (neighbours.normals[cone] * neighbours.areas[cone, None]).sum(0)
        total -= (total @ across) * across
        outward = total / max(float(np.linalg.norm(total)), 1e-300)
        height = centre[cone] @ outward
        level = _densest(height, neighbours.areas[cone], scale.strip_m)
        along = centre[cone] @ np.cross(across, outward)
        strip = cone[np.abs(height - level) <= 1.5 * scale.strip_m + MISALIGNED * np.abs(along - np.median(along))]
        supported = float(neighbours.areas[strip].sum()) / plate.thickness
        plane = _strip_plane(mesh, strip, outward, plate, scale) if supported > LONG * scale.spacing_m else None
        if plane is None or not plate.ends_at(plane, centre[strip], 4 * scale.spacing_m):
            left = np.setdiff1d(left, strip, assume_unique=True)
            continue
        own = cone[np.abs(plane.distance(centre[cone])) <= 1.5 * scale.strip_m]
        found.append((own, plane))
        left = np.setdiff1d(left, own if len(own) else strip, assume_unique=True)
    return found


def _densest(values: FloatArray, weights: FloatArray, width: float) -> float:
    """Middle of the window of `width` that holds the most weight."""
    order = np.argsort(values, kind="stable")
    v, total = values[order], np.concatenate([[0.0], np.cumsum(weights[order])])
    end = np.searchsorted(v, v + width, side="right")
    best = int((total[end] - total[:-1]).argmax())
    return float((v[best] + v[end[best] - 1]) / 2)


def _strip_plane(mesh: TriangleMesh, strip: IntArray, outward: FloatArray, plate: _Plate, scale: Scale) -> Plane | None:
    """The plane square to the plate through the points of a strip; None where these are bent."""
    along = np.cross(plate.across, outward)
    points = mesh.vertices[np.unique(mesh.faces[strip])]
    run = float(np.ptp(points @ along))
    depth = np.minimum(-plate.a.distance(points), -plate.b.distance(points))
    own = points[depth > INSIDE * plate.thickness]
    if len(own) < 4 or np.ptp(own @ along) < 0.5 * run:
        # no row of its own: the plate's points reach to within half a spacing of the edge, the outermost of them nearer
        normal = _likelier(outward, plate, UNSURE)
        return Plane(normal=normal, offset=float(np.percentile(points @ normal, 90)))
    x, y = own @ along, own @ outward
    middle = x.mean()
    slope, height, weight = _line(x - middle, y, scale.tolerance_m)
    rest = y - height - slope * (x - middle)
    if np.median(np.abs(rest)) > scale.strip_m or _bend(x - middle, rest, weight) > scale.strip_m:
        return None
    # y = height + slope (x - middle): the line's normal is outward - slope along
    normal = (outward - slope * along) / np.hypot(1.0, slope)
    error = scale.strip_m / max(float(np.sqrt((weight * (x - middle) ** 2).sum())), 1e-300)  # standard error of the slope
    normal = _likelier(normal, plate, 2.0 * error)
    return Plane(normal=normal, offset=float(np.average(own @ normal, weights=weight)))


def _likelier(normal: FloatArray, plate: _Plate, angle: float) -> FloatArray:
    """The nearest likely direction within `angle` (radians) of the one fitted, which the points cannot tell from it; else `normal`."""
    if not len(plate.likely):
        return normal
    best = plate.likely[int((plate.likely @ normal).argmax())]
    return best if np.arccos(np.clip(best @ normal, -1.0, 1.0)) <= angle else normal


def _line(x: FloatArray, y: FloatArray, scale: float) -> tuple[float, float, FloatArray]:
    """Slope and height at x = 0 of a line, and the weights that keep outliers down (Geman and McClure)."""
    weight = np.ones(len(x))
    slope, height = 0.0, float(np.median(y))
    for _ in range(8):
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        slope = float((weight * (x - mean_x) * (y - mean_y)).sum() / max((weight * (x - mean_x) ** 2).sum(), 1e-300))
        height = float(mean_y - slope * mean_x)
        weight = 1 / (1 + ((y - height - slope * x) / max(scale, 1e-300)) ** 2) ** 2
    return slope, height, weight


def _bend(x: FloatArray, rest: FloatArray, weight: FloatArray) -> float:
    """Height of the best parabola through the residuals of a line."""
    size = max(float(np.abs(x).max()), 1e-300)
    basis = np.stack([np.ones(len(x)), x / size, (x / size) ** 2], axis=1)
    root = np.sqrt(weight)
    return abs(float(np.linalg.lstsq(basis * root[:, None], rest * root, rcond=None)[0][2]))
