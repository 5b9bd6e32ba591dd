"""Remeshing: planes snapped flat, creases kept, triangles of finite element size (see docs/design.md)."""

from scan2fea.remeshing.ease import AIM_DEG, eased, worst_dihedral
from scan2fea.remeshing.even import Evened, chord_height, evened, looks_drawn
from scan2fea.remeshing.remesh import Remeshed, RemeshOptions, remesh

__all__ = ["AIM_DEG", "Evened", "RemeshOptions", "Remeshed", "chord_height", "eased", "evened", "looks_drawn", "remesh", "worst_dihedral"]
