"""How thick the walls are: a map in the view of the object, and a histogram with the noise beside it."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.thickness import face_thickness, wall_thickness
from scan2fea.report.camera import Camera
from scan2fea.report.charts import Limit, colour_bar, histogram, swatches
from scan2fea.report.colours import NO_DATA, VIRIDIS, css, gradient, viridis
from scan2fea.report.figures import DATA_CONTRAST, Figure, drawn
from scan2fea.report.markup import Html
from scan2fea.report.render import Shape, render
from scan2fea.report.words import number, percent
from scan2fea.types import TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

LONG = 3.0  # medians above which a thickness is a length (seen from an end) and gets the last colour
UNTOLD = 3.0  # standard deviations of the noise below which points alone do not tell two faces apart


def thickness_figure(surface: TriangleMesh, camera: Camera, sigma_m: float | None) -> Figure | None:
    """Of a closed surface: the way through the material along the normal, at each face, and by area as a histogram. None where nothing is met."""
    known = wall_thickness(surface) * MILLIMETRES_PER_METRE
    if not len(known):
        return None
    top = float(min(np.quantile(known, 0.99), LONG * np.median(known)))
    if not top > 0:
        return None
    each = face_thickness(surface) * MILLIMETRES_PER_METRE
    colours = viridis(np.nan_to_num(np.minimum(each / top, 1.0)))
    colours[~np.isfinite(each)] = NO_DATA
    legend = colour_bar(gradient(VIRIDIS), "0", "", f"{number(top, 3)} mm or more", "Thickness along the normal")
    if not np.isfinite(each).all():
        legend = Html(legend + swatches([(css(NO_DATA), "not met", False)]))
    limits: tuple[Limit, ...] = ()
    said = ""
    if sigma_m is not None and np.isfinite(sigma_m) and sigma_m > 0:
        noise = sigma_m * MILLIMETRES_PER_METRE
        limits = (Limit(at=noise, label="\u03c3"), Limit(at=UNTOLD * noise, label="3 \u03c3"))
        below = float((known < UNTOLD * noise).mean())
        said = f"; {percent(below) if below > 0 else 'none'} of it is thinner than 3 \u03c3 of the noise"
    axis = "thickness along the normal, mm"
    chart = histogram(known, low=0.0, high=1.08 * top, axis=axis, title="Thickness", limits=limits, palette=lambda share: viridis(share * 1.08))
    shape = Shape(vertices=surface.vertices, faces=surface.faces, colours=colours, contrast=DATA_CONTRAST)
    middle = number(float(np.median(known)))
    caption = f"Median of the area {middle} mm{said}."
    return drawn("Thickness", f"Map of the thickness; median {middle} mm{said}.", caption, camera, render(camera, (shape,)), legend, chart)
