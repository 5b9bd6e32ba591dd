"""Pictures of clouds and meshes for the thesis's figures: the same view for what is compared."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.measures import face_vectors
from scan2fea.kernel.noise import sampled_rows, spacing
from scan2fea.kernel.quality import triangle_quality
from scan2fea.report.camera import Camera, framed, look_at, look_down
from scan2fea.report.colours import PLAIN, categories, viridis
from scan2fea.report.render import Dots, Shape, render
from scan2fea.thesis.canvas import tiles
from scan2fea.types import ByteArray, FloatArray, IntArray, TriangleMesh

DRAWN = 120_000
WIDE, HIGH = 620, 400
CLOSE_SHARE = 0.06  # of the length of a long thing that the close view shows


def cloud_picture(points: FloatArray, colours: ByteArray | None = None, camera: Camera | None = None, width: int = WIDE) -> ByteArray:
    """(h, w, 3) points (n, 3), at most 120,000 of them."""
    rows = sampled_rows(len(points), DRAWN, 0)
    shown = points[rows]
    camera = look_down(shown, width_px=width, height_px=round(width * HIGH / WIDE)) if camera is None else camera
    distance = spacing(shown) if len(shown) > 1 else np.nan
    radius = float(np.clip(0.75 * distance / camera.m_per_px, 0.8, 4.0)) if np.isfinite(distance) else 1.5
    return render(camera, (Dots(points=shown, colours=None if colours is None else colours[rows], radius_px=radius),))


def labelled_picture(points: FloatArray, labels: IntArray, width: int = WIDE) -> ByteArray:
    """(h, w, 3) points in the colours of their labels; below 0: grey."""
    return cloud_picture(points, categories(labels), width=width)


def mesh_picture(mesh: TriangleMesh, camera: Camera, *, lines: bool = False) -> ByteArray:
    """(h, w, 3) faces coloured by their shape, 2 r / R: yellow equilateral, dark blue degenerate."""
    shape = np.asarray(triangle_quality(mesh.vertices, mesh.faces)["radius_ratio"])
    return render(camera, (Shape(vertices=mesh.vertices, faces=mesh.faces, colours=viridis(shape), smooth=False, lines=lines, contrast=0.7),))


def plain_picture(mesh: TriangleMesh, camera: Camera) -> ByteArray:
    """(h, w, 3) the surface in one colour."""
    return render(camera, (Shape(vertices=mesh.vertices, faces=mesh.faces, colours=np.tile(PLAIN, (len(mesh.faces), 1))),))


def views_of(points: FloatArray, normals: FloatArray | None = None) -> tuple[Camera, Camera]:
    """The view of all of a long thing, and of one of its ends from the same side."""
    whole = look_at(points, width_px=WIDE, height_px=HIGH, normals=normals)
    across = points @ whole.axes[0]
    near = points[across <= across.min() + max(CLOSE_SHARE * float(np.ptp(across)), 0.12)]
    return whole, framed(near, whole.axes, WIDE, HIGH)


def mesh_figure(mesh: TriangleMesh, views: tuple[Camera, Camera], below: str = "") -> bytes:
    """PNG of the whole surface and of its end with the edges of its triangles."""
    whole, close = views
    return tiles([("all of it", mesh_picture(mesh, whole)), ("one end", mesh_picture(_near(mesh, close), close, lines=True))], 2, below)


def cloud_figure(points: FloatArray, views: tuple[Camera, Camera], below: str = "") -> bytes:
    """PNG of points, all and one end."""
    return tiles([("all of it", cloud_picture(points, camera=views[0])), ("one end", cloud_picture(points, camera=views[1]))], 2, below)


def _near(mesh: TriangleMesh, camera: Camera) -> TriangleMesh:
    """The faces that the camera sees: the others need not be drawn."""
    seen = camera.project(mesh.vertices)
    inside = (seen[:, 0] > -camera.width_px) & (seen[:, 0] < 2 * camera.width_px)
    faces = mesh.faces[inside[mesh.faces].any(axis=1)]
    return TriangleMesh(vertices=mesh.vertices, faces=faces)


def normals_of(mesh: TriangleMesh) -> FloatArray:
    """(m, 3) weighted by area."""
    return face_vectors(mesh.vertices, mesh.faces)
