"""Volume meshes: tets inside a closed surface, by gmsh in a child process."""

from scan2fea.tetmeshing.dirty import ENVELOPE, new_boundary
from scan2fea.tetmeshing.fill import Filled, FillOptions, fill
from scan2fea.tetmeshing.layers import layered

__all__ = ["ENVELOPE", "FillOptions", "Filled", "fill", "layered", "new_boundary"]
