"""The picture of a simulated scene: its solids each in its own colour, and where the sensors stood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.report.camera import framed, look_down
from scan2fea.report.colours import BACKDROP, categories
from scan2fea.report.render import Dots, Shape, png, render
from scan2fea.types import ByteArray, FloatArray, Scan, TriangleMesh

SENSOR_COLOUR = np.array([200, 40, 30], np.uint8)
_MOST_PLACES = 400
_SENSOR_PX = 3.0


def scene_picture(solids: Sequence[TriangleMesh], scans: Sequence[Scan]) -> bytes:
    """PNG. The first solid is drawn in grey where it is the widest by far (a floor), the others in the colours of categories."""
    vertices = np.concatenate([m.vertices for m in solids])
    places = _places(scans)
    every = np.concatenate([vertices, places])
    camera = look_down(every)
    camera = framed(every, camera.axes, camera.width_px, camera.height_px)  # all of it: there is no stray point in a scene
    widest = [float(np.linalg.norm(np.ptp(m.vertices[:, :2], axis=0))) for m in solids]
    things: list[Shape | Dots] = []
    for number, mesh in enumerate(solids):
        is_floor = number == 0 and len(solids) > 1 and widest[0] > 1.05 * max(widest[1:])
        colour: ByteArray = BACKDROP if is_floor else categories(np.array([number]))[0]
        things.append(Shape(vertices=mesh.vertices, faces=mesh.faces, colours=np.tile(colour, (len(mesh.faces), 1))))
    if len(places):
        things.append(Dots(points=places, colours=np.tile(SENSOR_COLOUR, (len(places), 1)), radius_px=_SENSOR_PX))
    return png(render(camera, tuple(things)))


def _places(scans: Sequence[Scan]) -> FloatArray:
    """(k, 3) where rays start, of moving sensors a sample."""
    origins = [s.rays.origin for s in scans if s.rays is not None and len(s.rays)]
    if not origins:
        return np.zeros((0, 3))
    every = np.concatenate([o[np.linspace(0, len(o) - 1, min(len(o), _MOST_PLACES)).astype(int)] for o in origins])
    kept = np.unique(every, axis=0)
    return np.asarray(kept[np.linspace(0, len(kept) - 1, min(len(kept), _MOST_PLACES)).astype(int)])
