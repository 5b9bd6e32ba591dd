"""The pictures of one object's cloud and surface, and of the whole scene. What is not there is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.measures import face_vectors
from scan2fea.kernel.noise import sampled_rows, spacing
from scan2fea.report.camera import Camera, look_at, look_down
from scan2fea.report.charts import Limit, colour_bar, histogram, swatches
from scan2fea.report.colours import BACKDROP, CATEGORIES, DIVERGING, NO_DATA, ORIGIN_COLOURS, ORIGIN_NAMES, categories, css, diverging, gradient
from scan2fea.report.markup import NOTHING, Html
from scan2fea.report.render import Dots, Shape, png, render
from scan2fea.report.words import number, percent
from scan2fea.types import INVENTED, MEASURED, BoolArray, ByteArray, FloatArray, PointCloud, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

Pins = Mapping[int, tuple[float, float]]

DRAWN_POINTS = 150_000  # more cannot be told apart in a picture of this size
SMALL_FACE = 0.005  # share of the area below which a CAD face gets no colour of its own
LISTED_FACES = 12
DATA_CONTRAST = 0.4  # of light and shade where colours mean figures
PIN_SHARE, PIN_ROUNDS = 0.075, 60  # of the width of the scene: the size of a pin on a phone
DISC_SPACINGS = 0.75  # radius of a point in spacings: neighbours just touch, a surface looks closed


@dataclass(frozen=True, eq=False, kw_only=True)
class Figure(Value):
    """A picture ready for the page. png : its bytes.   scale_m_per_px : for the scale bar.   legend, chart : what stands under it."""

    title: str
    alt: str
    caption: str
    png: bytes
    width_px: int
    height_px: int
    scale_m_per_px: float
    legend: Html = NOTHING
    chart: Html = NOTHING


def drawn(title: str, alt: str, caption: str, camera: Camera, picture: ByteArray, legend: Html = NOTHING, chart: Html = NOTHING) -> Figure:
    """The Figure of a picture made through a camera."""
    return Figure(
        title=title,
        alt=alt,
        caption=caption,
        png=png(picture),
        width_px=camera.width_px,
        height_px=camera.height_px,
        scale_m_per_px=camera.m_per_px,
        legend=legend,
        chart=chart,
    )


def camera_for(cloud: PointCloud | None, surface: TriangleMesh | None, width_px: int) -> Camera | None:
    """The one view of an object: around all that will be drawn, from where most of its measured surface shows."""
    height_px = round(width_px * 0.64)
    shown = [] if cloud is None else [cloud.points]
    normals: FloatArray | None = None if cloud is None else cloud.normals
    if surface is not None and len(surface.faces):
        shown.append(surface.vertices[np.unique(surface.faces)])
        normals = face_vectors(surface.vertices, surface.faces)
        if surface.face_origin is not None and (surface.face_origin == MEASURED).any():
            normals = normals[surface.face_origin == MEASURED]
    points = np.concatenate([part[np.isfinite(part).all(axis=1)] for part in shown]) if shown else np.zeros((0, 3))
    return look_at(points, width_px=width_px, height_px=height_px, normals=normals) if len(points) else None


def points_figure(cloud: PointCloud, camera: Camera) -> Figure:
    """The points as they were kept; coloured as scanned where the scanner gave colours, otherwise plain; inferred ones stand out."""
    rows = sampled_rows(len(cloud), DRAWN_POINTS, 0)
    inferred = None if cloud.is_inferred is None else cloud.is_inferred[rows]
    colours = np.tile(np.array([92, 128, 158], np.uint8), (len(rows), 1)) if cloud.colour is None else cloud.colour[rows].copy()
    legend = NOTHING
    if inferred is not None and inferred.any():
        colours[inferred] = ORIGIN_COLOURS[INVENTED]
        legend = swatches([(css(ORIGIN_COLOURS[INVENTED]), f"inferred, not measured ({percent(float(inferred.mean()))})", False)])
    kept = "" if len(rows) == len(cloud) else f" ({len(rows):,} drawn)"
    picture = render(camera, (dots(cloud.points[rows], colours, camera),))
    return drawn("Points", f"The {len(cloud):,} points of the object.", f"The points that were used: {len(cloud):,}{kept}.", camera, picture, legend)


def origin_figure(surface: TriangleMesh, camera: Camera) -> Figure | None:
    """The surface coloured by what is known of it: measured, interpolated between measurements, or invented to close it."""
    if surface.face_origin is None:
        return None
    area = np.linalg.norm(face_vectors(surface.vertices, surface.faces), axis=1)
    origin = np.clip(surface.face_origin, 0, 2)
    shares = np.bincount(origin, weights=area, minlength=3) / max(area.sum(), 1e-300)
    shape = Shape(vertices=surface.vertices, faces=surface.faces, colours=ORIGIN_COLOURS[origin], hatched=origin == INVENTED, contrast=DATA_CONTRAST)
    told = [f"{name} {percent(float(share))}" for name, share in zip(ORIGIN_NAMES, shares, strict=True)]
    legend = swatches([(css(colour), text, k == INVENTED) for k, (colour, text) in enumerate(zip(ORIGIN_COLOURS, told, strict=True))])
    return drawn("What was seen", f"The surface: {', '.join(told)} of its area.", "Shares of the area.", camera, render(camera, (shape,)), legend)


def plain_figure(surface: TriangleMesh, camera: Camera) -> Figure:
    """The surface as it is, where nothing is known of its faces: one that was given, or what there was when the conversion stopped."""
    shape = Shape(vertices=surface.vertices, faces=surface.faces)
    caption = f"The last surface that was made: {len(surface.faces):,} triangles."
    return drawn("Surface", f"The surface of {len(surface.faces):,} triangles.", caption, camera, render(camera, (shape,)))


def deviation_figure(surface: TriangleMesh, camera: Camera, sigma_m: float | None) -> Figure | None:
    """Signed distance of the points from the surface, as a map and as a histogram in the same colours."""
    if surface.deviation_m is None or not np.isfinite(surface.deviation_m).any():
        return None
    deviation = np.where(_near_points(surface), surface.deviation_m, np.nan)
    known = deviation[np.isfinite(deviation)]
    if not len(known):
        return None
    limit, what = _deviation_limit(known, sigma_m)
    shape = Shape(vertices=surface.vertices, faces=surface.faces, colours=diverging(deviation / limit), per_vertex=True, contrast=DATA_CONTRAST)
    end = number(limit * MILLIMETRES_PER_METRE, 3)
    legend = colour_bar(gradient(DIVERGING), f"\u2212{end} mm (inside)", "0", f"+{end} mm (outside)", f"Points to surface, limits {what}")
    if len(known) < len(deviation):
        legend = Html(legend + swatches([(css(NO_DATA), f"no point near ({percent(1 - len(known) / len(deviation))} of the vertices)", False)]))
    shown = known * MILLIMETRES_PER_METRE
    shown_limit = limit * MILLIMETRES_PER_METRE
    chart = histogram(
        shown,
        low=-1.35 * shown_limit,
        high=1.35 * shown_limit,
        axis="distance of the points from the surface, mm",
        title="Signed deviation",
        limits=(Limit(at=-shown_limit, label=f"\u2212{what}"), Limit(at=shown_limit, label=f"+{what}")),
        palette=lambda share: diverging((share - 0.5) * 2 * 1.35),
    )
    alt = f"Map of the signed deviation; median {number(float(np.median(shown)))} mm, limits \u00b1{end} mm."
    return drawn("Deviation", alt, "White is zero; blue: the points lie inside, red: outside.", camera, render(camera, (shape,)), legend, chart)


def regions_figure(surface: TriangleMesh, camera: Camera, cad: Mapping[str, Any]) -> Figure | None:
    """The faces of the CAD solid in distinct colours, the largest first; single facets of a free form stay grey."""
    if surface.face_region is None or not (surface.face_region >= 0).any():
        return None
    region = np.maximum(surface.face_region, -1) + 1  # 0: on no face
    area = np.bincount(region, weights=np.linalg.norm(face_vectors(surface.vertices, surface.faces), axis=1))
    share = area / max(float(area.sum()), 1e-300)
    share[0] = 0.0
    large = np.flatnonzero((share >= SMALL_FACE) & (np.bincount(region) > 1))
    large = large[np.argsort(-share[large], kind="stable")]
    if not len(large):
        return None
    rank = np.full(len(share), -1)
    rank[large] = np.arange(len(large))
    names = cad.get("face_names") or []
    told = [f"{names[k - 1] if k <= len(names) else f'face {k}'} ({percent(float(share[k]))})" for k in large[:LISTED_FACES].tolist()]
    items = [(css(categories(np.array([k]))[0]), text, False) for k, text in enumerate(told)]
    rest = 1 - float(share[large].sum())
    items += [(css(BACKDROP), f"small faces and facets ({percent(rest)})", False)] if rest > 1e-9 else []
    shape = Shape(vertices=surface.vertices, faces=surface.faces, colours=categories(rank[region]), smooth=rest > SMALL_FACE, contrast=0.7)
    caption = f"{len(large)} faces with more than {percent(SMALL_FACE)} of the area each"
    caption += f", the {LISTED_FACES} largest named." if len(large) > LISTED_FACES else "."
    alt = f"The surface with its {len(large)} largest CAD faces in distinct colours."
    return drawn("CAD faces", alt, caption, camera, render(camera, (shape,)), swatches(items))


def scene_figure(scene: PointCloud | None, objects: Sequence[PointCloud | None], width_px: int = 1100) -> tuple[Figure, Pins] | None:
    """The whole cloud in grey with its objects in colours, and where their numbers belong.

    Returns None without any point, else the figure and {place in `objects`: (left, top)} as shares of the picture.
    """
    share = DRAWN_POINTS // max(len(objects), 1)
    clouds = {k: _some(cloud, share) for k, cloud in enumerate(objects) if cloud is not None and len(cloud)}
    around = _some(scene, DRAWN_POINTS) if scene is not None and len(scene) else np.zeros((0, 3))
    owned = [cloud.points for cloud in objects if cloud is not None and len(cloud)]
    if owned and len(around):  # the scene holds the points of the objects too: in grey they would cover the coloured ones
        points = np.concatenate(owned)
        around = around[~np.isfinite(cKDTree(points).query(around, distance_upper_bound=1e-9 * max(float(np.abs(points).max()), 1e-3))[0])]
    everything = np.concatenate([around, *clouds.values()])
    if not len(everything):
        return None
    camera = look_down(np.concatenate([*clouds.values()]) if clouds else around, width_px=width_px, height_px=round(width_px * 0.56))
    things = [dots(points, np.tile(categories(np.array([k])), (len(points), 1)), camera) for k, points in clouds.items()]
    if len(around):
        things.append(dots(around, np.tile(BACKDROP, (len(around), 1)), camera))
    picture = render(camera, tuple(things))
    pins = {}
    for k, points in clouds.items():
        x, y = np.median(camera.project(points)[:, :2], axis=0)
        pins[k] = (float(np.clip(x / camera.width_px, 0.02, 0.98)), float(np.clip(y / camera.height_px, 0.03, 0.97)))
    pins = apart(pins, camera.height_px / camera.width_px)
    items = [(css(CATEGORIES[0]), "objects, each with its number", False)] if pins else []
    items += [(css(BACKDROP), "support and surroundings", False)] if len(around) else []
    n_points = len(scene) if scene is not None else len(everything)
    alt = f"The scene of {n_points:,} points with {len(pins)} numbered objects."
    return drawn("The scene", alt, "Press a number to go to the object.", camera, picture, swatches(items)), pins


def apart(pins: Pins, shape: float) -> dict[int, tuple[float, float]]:
    """Pins moved until none covers another: (left, top) as shares of a picture that is `shape` times as high as wide.

    Each pair that is too close moves apart along the line between them, to the sides where there is none; what is crowded stays crowded.
    """
    names = list(pins)
    at = np.array([pins[k] for k in names], float).reshape(-1, 2) * np.array([1.0, shape])
    for _ in range(PIN_ROUNDS):
        gap = at[:, None] - at[None]
        far = np.linalg.norm(gap, axis=2)
        close = np.triu((far < PIN_SHARE) & ~np.eye(len(at), dtype=bool))
        if not close.any():
            break
        for i, j in np.argwhere(close):
            way = gap[i, j] / far[i, j] if far[i, j] > 1e-9 else np.array([-1.0, 0.0])
            step = 0.5 * (PIN_SHARE - far[i, j]) + 1e-6
            at[i] += step * way
            at[j] -= step * way
        at = np.clip(at, [0.02, 0.03 * shape], [0.98, 0.97 * shape])
    return {k: (float(x), float(y / shape)) for k, (x, y) in zip(names, at, strict=True)}


def _some(cloud: PointCloud, at_most: int) -> FloatArray:
    return cloud.points[sampled_rows(len(cloud), max(at_most, 1), 0)]


def dots(points: FloatArray, colours: ByteArray, camera: Camera) -> Dots:
    distance = spacing(points) if len(points) > 1 else 0.0
    radius = float(np.clip(DISC_SPACINGS * distance / camera.m_per_px, 0.8, 4.0)) if np.isfinite(distance) else 1.5
    return Dots(points=points, colours=colours, radius_px=radius)


def _near_points(surface: TriangleMesh) -> BoolArray:
    """(n,) the vertices of faces that were measured: elsewhere there is no point to deviate from."""
    if surface.face_origin is None:
        return np.ones(len(surface.vertices), bool)
    near = np.zeros(len(surface.vertices), bool)
    near[surface.faces[surface.face_origin == MEASURED]] = True
    return near


def _deviation_limit(known: FloatArray, sigma_m: float | None) -> tuple[float, str]:
    """The ends of the scale: 3 sigma of the scanner where it is known and shows the data, otherwise 3 robust deviations of what is shown."""
    robust = 3 * 1.4826 * float(np.median(np.abs(known)))
    if sigma_m and np.isfinite(sigma_m) and 0.25 * robust <= 3 * sigma_m:
        return 3 * sigma_m, "3 \u03c3"
    limit = max(robust, float(np.quantile(np.abs(known), 0.9)))
    return (limit, "3 robust \u03c3") if limit > 0 else (1e-6, "1 \u00b5m")
