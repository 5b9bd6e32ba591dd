"""From a cloud to labelled things: supports, then the chosen method, then what only the whole scene tells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.kernel.near_tree import near_tree
from scan2fea.kernel.threads import in_threads
from scan2fea.segmentation.agglomerative import agglomerative
from scan2fea.segmentation.divisive import divisive
from scan2fea.segmentation.euclidean import euclidean
from scan2fea.segmentation.fuzzy_cmeans import fuzzy_cmeans
from scan2fea.segmentation.given import given
from scan2fea.segmentation.hidden_gaps import one_bar
from scan2fea.segmentation.kmeans import kmeans
from scan2fea.segmentation.learned import learned, learned_parts
from scan2fea.segmentation.members import members
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.segmentation.planes import PlaneFinder
from scan2fea.segmentation.primitives import find_primitives, primitive_row, primitives
from scan2fea.segmentation.radius import link_radius
from scan2fea.segmentation.scan_lines import across_lines
from scan2fea.segmentation.scenes import things_of
from scan2fea.segmentation.shadow import one_section
from scan2fea.segmentation.single import single
from scan2fea.segmentation.supports import Supports, find_supports
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Scan, Segments

Method = Callable[[PointCloud, SegmentationOptions], IntArray]
_Together = Callable[[FloatArray, Sequence[IntArray], FloatArray, int], IntArray]  # points, parts, sensors, seed -> number of each part's object

METHODS: Mapping[str, Method] = {
    "euclidean": euclidean,
    "kmeans": kmeans,
    "fuzzy_cmeans": fuzzy_cmeans,
    "agglomerative": agglomerative,
    "divisive": divisive,
    "learned": learned,
    "primitives": primitives,
    "given": given,
    "single": single,
}
FINAL = ("given", "single")  # their labels are taken as they are: no support is looked for


def segment_scene(scan: Scan, options: SegmentationOptions = SegmentationOptions()) -> Segments:
    """One label per point: supports first, then things from the largest to the smallest, ties by their first point.

    Raises UsageError for a method that does not exist, SegmentationError where the method cannot run.
    """
    says = f"segmentation.method {options.method!r} does not exist: use one of {', '.join(METHODS)}"
    require(options.method in METHODS, UsageError, says)
    cloud = scan.cloud
    if options.method in FINAL:
        final = METHODS[options.method](cloud, options)
        return Segments(labels=final, kinds=("object",) * (int(final.max(initial=-1)) + 1), how={"method": options.method})
    if options.method == "learned":  # it names floors and walls itself
        return _of_parts(len(cloud), learned_parts(cloud, options), {"method": "learned"})
    if options.method == "primitives":  # a floor is a plane as any other
        found = find_primitives(cloud.points, options.min_points, options.seed)
        told: Mapping[str, object] = {"method": "primitives", "primitives": [primitive_row(p) for p in found]}
        return _of_parts(len(cloud), [(p.rows, "object") for p in found], told)
    tree = near_tree(cloud.points) if len(cloud) else None
    radius = options.radius_m or link_radius(cloud.points, options.seed, tree)
    supports, finder = Supports.none(len(cloud)), PlaneFinder(cloud.points, options.seed)
    if options.supports and np.isfinite(radius) and radius > 0:
        supports = find_supports(finder, scan.sensors(), radius, options.min_points, tree)
    del tree  # as large as the cloud
    rest = np.flatnonzero(supports.number < 0)
    labels = METHODS[options.method](cloud.take(rest), options)
    clusters = [rest[labels == label] for label in range(int(labels.max(initial=-1)) + 1)]
    own_radius = options.radius_m or link_radius(cloud.points[rest], options.seed)
    joined = np.zeros(len(cloud), bool)
    if options.method == "euclidean" and options.radius_m is None and np.isfinite(own_radius):
        clusters, joined = across_lines(scan, clusters, own_radius)
    if options.supports and (len(clusters) > 1 or supports.planes) and np.isfinite(own_radius) and own_radius > 0:
        things = things_of(finder, clusters, supports, own_radius, options.min_points)
        pieces = [(thing.rows, thing.kind) for thing in things]
    else:
        pieces = [(rows, "object") for rows in clusters]
    n_across = 0
    if options.members and options.method == "euclidean":
        pieces, n_across = _of_one_section(_by_members(cloud.points, pieces, joined, options), scan, options.seed)
    how: dict[str, object] = {"method": options.method, "radius_m": own_radius, "n_supports": len(supports.planes), "n_things": len(pieces)}
    how |= {"n_across_shadows": n_across} if n_across else {}
    return _numbered(supports, pieces, how)


def _of_parts(n: int, parts: list[tuple[IntArray, str]], how: Mapping[str, object]) -> Segments:
    """Segments of n points from rows and roles: supports first, then the others from the largest to the smallest."""
    labels = np.full(n, -1, np.int64)
    ordered = sorted(parts, key=lambda part: (part[1] != "support", -len(part[0]), int(part[0][0])))
    for label, (rows, _) in enumerate(ordered):
        labels[rows] = label
    return Segments(labels=labels, kinds=tuple(role for _, role in ordered), how={**how, "n_things": len(parts)})


def _by_members(
    points: FloatArray, pieces: list[tuple[IntArray, str]], joined: BoolArray, options: SegmentationOptions
) -> list[tuple[IntArray, str]]:
    """The same, with objects that are made of several members cut into these; not what scan lines far apart show (`joined`, (n,) points)."""

    def labels_of(piece: tuple[IntArray, str]) -> IntArray:
        rows, kind = piece
        is_whole = kind != "object" or joined[rows].any()
        return np.zeros(len(rows), np.int64) if is_whole else members(points[rows], options.seed, options.min_points, options.slenderness)

    out: list[tuple[IntArray, str]] = []
    for (rows, kind), labels in zip(pieces, in_threads(labels_of, pieces), strict=True):
        out += [(rows[labels == label], kind) for label in range(int(labels.max(initial=-1)) + 1)]
    return out


def _of_one_section(pieces: list[tuple[IntArray, str]], scan: Scan, seed: int) -> tuple[list[tuple[IntArray, str]], int]:
    """The same, with objects that are parts of one section, or one bar half hidden, put together; how many gaps of bars were so bridged."""
    sensors = scan.sensors()
    whole = _merged([rows for rows, kind in pieces if kind == "object"], one_section, scan, sensors, seed)
    objects = _merged(whole, one_bar, scan, sensors, seed)
    return [(rows, "object") for rows in objects] + [(rows, kind) for rows, kind in pieces if kind != "object"], len(whole) - len(objects)


def _merged(objects: list[IntArray], together: _Together, scan: Scan, sensors: FloatArray, seed: int) -> list[IntArray]:
    number = together(scan.cloud.points, objects, sensors, seed)
    return [np.sort(np.concatenate([objects[k] for k in np.flatnonzero(number == n)])) for n in range(int(number.max(initial=-1)) + 1)]


def _numbered(supports: Supports, pieces: list[tuple[IntArray, str]], how: Mapping[str, object]) -> Segments:
    labels = np.full(len(supports.number), -1, np.int64)
    kinds: list[str] = []
    for i in range(len(supports.planes)):
        labels[supports.number == i] = len(kinds)
        kinds.append("support")
    for rows, kind in sorted(pieces, key=lambda piece: (-len(piece[0]), int(piece[0].min(initial=0)))):
        labels[rows] = len(kinds)
        kinds.append(kind)
    return Segments(labels=labels, kinds=tuple(kinds), how=how)
