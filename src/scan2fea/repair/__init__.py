"""Repair: from any triangle mesh to one closed, manifold, outward shell without crossings, or an error that says what is left."""

from scan2fea.repair.repair import Repaired, RepairOptions, repair
from scan2fea.repair.shells import bodies, faces_among

__all__ = ["RepairOptions", "Repaired", "bodies", "faces_among", "repair"]
