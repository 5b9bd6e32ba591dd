"""Volume meshes: tets inside a closed surface, by gmsh in a child process."""

from scan2fea.tetmeshing.fill import Filled, FillOptions, fill

__all__ = ["FillOptions", "Filled", "fill"]
