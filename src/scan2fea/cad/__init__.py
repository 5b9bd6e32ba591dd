"""B-Rep and STEP: a surface to a CAD solid (AP214, millimetres) of true faces or of facets, several solids to one assembly."""

from scan2fea.cad.assembly import assembly
from scan2fea.cad.boxed import BOX_OFF, box_off_m
from scan2fea.cad.brep import CadOptions, to_brep
from scan2fea.cad.compared import LEAST_LOST
from scan2fea.cad.drawn_solid import drawn_solid
from scan2fea.cad.drilled import Drilled, drilled
from scan2fea.cad.freeform import patched_solid
from scan2fea.cad.nominal import placed_drawing, read_nominal
from scan2fea.cad.prism import prism_brep
from scan2fea.cad.sheets import FACET
from scan2fea.cad.solid import QUILTED, WHOLE, true_solid
from scan2fea.cad.surfaces import Snap
from scan2fea.cad.trued import PATCH, Trued

__all__ = [
    "BOX_OFF", "FACET", "LEAST_LOST", "PATCH", "QUILTED", "WHOLE", "CadOptions", "Drilled", "Snap", "Trued", "assembly", "box_off_m", "drawn_solid",
    "drilled", "patched_solid", "placed_drawing", "prism_brep", "read_nominal", "to_brep", "true_solid",
]  # fmt: skip
