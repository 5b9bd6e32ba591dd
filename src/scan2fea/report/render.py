"""Pictures without a display: triangles, points and lines, drawn by a small software rasteriser at twice the size and averaged down."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import face_vectors
from scan2fea.report.camera import Camera
from scan2fea.report.colours import PLAIN
from scan2fea.report.raster import averaged, blank, draw_discs, draw_lines, draw_triangles, shade_depth
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray, Value

SUPERSAMPLING = 2
BACKGROUND = np.array([250.0, 250.0, 248.0])
EDGE_COLOUR = np.array([38.0, 44.0, 52.0])
CREASE_COS = float(np.cos(np.radians(38.0)))  # faces that meet at less are shaded as one smooth surface
LIGHTS = np.array([[-0.35, 0.55, 0.76], [0.75, 0.05, 0.66], [0.0, -0.6, 0.8]])  # key, fill, from below; in the axes of the picture
STRENGTHS = np.array([0.52, 0.26, 0.12])
AMBIENT = 0.36


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape(Value):
    """Triangles to draw. colours : (m, 3) per face or (n, 3) per vertex, bytes; None: plain.   lines : show the edges of the faces.

    contrast : of light and shade; less where the colours are to be compared with a legend.
    hatched : (m,) bool, faces with stripes over their colour (what must be told apart without colours), or None.
    """

    vertices: FloatArray
    faces: IntArray
    colours: ByteArray | None = None
    per_vertex: bool = False
    smooth: bool = True
    lines: bool = False
    contrast: float = 1.0
    hatched: BoolArray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Dots(Value):
    """Points to draw. colours : (n, 3) bytes or None.   radius_px in pixels of the finished picture."""

    points: FloatArray
    colours: ByteArray | None = None
    radius_px: float = 1.2


def render(camera: Camera, things: tuple[Shape | Dots, ...]) -> ByteArray:
    """(h, w, 3) bytes. Deterministic; no display, no GL."""
    s = SUPERSAMPLING
    image, depth = blank(camera.height_px * s, camera.width_px * s, BACKGROUND)
    for thing in things:
        if isinstance(thing, Shape):
            _shape(thing, camera, image, depth)
        else:
            _dots(thing, camera, image, depth)
    has_dots = any(isinstance(thing, Dots) for thing in things)
    _shade(image, depth, soft=has_dots)
    return averaged(image, s)


def png(picture: ByteArray, n_colours: int = 160) -> bytes:
    """The picture as PNG with a palette: a third of the bytes of full colour, and no difference that one sees."""
    from PIL import Image

    stream = io.BytesIO()
    few = Image.fromarray(picture).quantize(colors=n_colours, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(stream, "PNG", compress_level=6)  # 9 takes ten times as long for 3 % less
    return stream.getvalue()


def corner_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3, 3) a normal per corner: the mean over the faces around the vertex that meet this one without a crease."""
    vectors = face_vectors(vertices, faces)
    normal = _unit(vectors)
    n_faces = len(faces)
    vertex = faces.ravel()
    order = np.argsort(vertex, kind="stable")
    start = np.searchsorted(vertex[order], np.arange(len(vertices) + 1))
    around = (start[1:] - start[:-1])[vertex]  # faces around each corner's vertex
    corner = np.repeat(np.arange(3 * n_faces), around)
    rank = np.arange(len(corner)) - np.repeat(np.cumsum(around) - around, around)
    own, other = corner // 3, order[start[vertex[corner]] + rank] // 3
    meets = np.einsum("ij,ij->i", normal[own], normal[other]) > CREASE_COS
    weighted = vectors[other] * meets[:, None]
    total = np.stack([np.bincount(corner, weights=weighted[:, k], minlength=3 * n_faces) for k in range(3)], axis=1)
    return _unit(np.asarray(total, float)).reshape(n_faces, 3, 3)


def _unit(vectors: FloatArray) -> FloatArray:
    """(n, 3) unit vectors; zero stays zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))


def _shape(shape: Shape, camera: Camera, image: FloatArray, depth: FloatArray) -> None:
    if len(shape.faces) == 0:
        return
    vertices, faces = shape.vertices, shape.faces.astype(np.int64)
    normals = corner_normals(vertices, faces) if shape.smooth else np.repeat(_unit(face_vectors(vertices, faces))[:, None, :], 3, axis=1)
    base = np.broadcast_to(PLAIN, (len(faces), 3)) if shape.colours is None else shape.colours
    corners = base[faces] if shape.per_vertex and shape.colours is not None else np.repeat(base[:, None, :], 3, axis=1)
    screen = camera.project(vertices) * SUPERSAMPLING
    bright = 1 - shape.contrast * (1 - _light(camera.turned(normals.reshape(-1, 3))))
    lit = corners * bright.reshape(-1, 3, 1)
    draw_triangles(screen, faces, lit, image, depth)
    if shape.hatched is not None and shape.hatched.any():
        _hatch(screen, faces, shape.hatched, image, depth)
    if shape.lines:
        ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        draw_lines(screen, np.unique(ends, axis=0), EDGE_COLOUR, 1.5, 0.5, image, depth)


def _hatch(screen: FloatArray, faces: IntArray, hatched: BoolArray, image: FloatArray, depth: FloatArray) -> None:
    """Stripes on the pixels where a hatched face is what one sees."""
    mask, near = blank(depth.shape[0], depth.shape[1], np.zeros(3))
    draw_triangles(screen, faces, np.repeat(hatched.astype(float), 9).reshape(-1, 3, 3), mask, near)
    rows, columns = np.indices(depth.shape)
    stripe = (mask[:, :, 0] > 0.5) & (near >= depth) & ((rows + columns) % (9 * SUPERSAMPLING) < 2 * SUPERSAMPLING)
    image[stripe] *= 0.45


def _light(normal: FloatArray) -> FloatArray:
    """(n,) brightness of surfaces whose normals (axes of the picture) are given; the back of a face is lit like its front, a little darker."""
    behind = normal[:, 2] < 0
    facing = np.where(behind[:, None], -normal, normal)
    bright = AMBIENT + np.maximum(facing @ (LIGHTS / np.linalg.norm(LIGHTS, axis=1)[:, None]).T, 0) @ STRENGTHS
    return np.asarray(np.minimum(bright, 1.08) * np.where(behind, 0.72, 1.0))


def _dots(dots: Dots, camera: Camera, image: FloatArray, depth: FloatArray) -> None:
    base = np.broadcast_to(PLAIN, dots.points.shape) if dots.colours is None else dots.colours
    draw_discs(camera.project(dots.points) * SUPERSAMPLING, base.astype(np.float64), dots.radius_px * SUPERSAMPLING, image, depth)


def _shade(image: FloatArray, depth: FloatArray, *, soft: bool) -> None:
    """Outlines of surfaces; softer and wider ones where there are points."""
    seen = depth[np.isfinite(depth)]
    if len(seen):
        unit = 0.02 * float(np.ptp(seen)) + 1.0
        start, strength, near, far = (0.15, 1.6, 2, 4) if soft else (0.6, 0.75, 1, 0)
        shade_depth(image, depth, unit, start, strength, near, far)
