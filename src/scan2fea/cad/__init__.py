"""B-Rep and STEP: triangles to a CAD solid (AP214, millimetres), several solids to one assembly."""

from scan2fea.cad.assembly import assembly
from scan2fea.cad.brep import CadOptions, to_brep
from scan2fea.cad.prism import prism_brep

__all__ = ["CadOptions", "assembly", "prism_brep", "to_brep"]
