"""Repair: from any triangle mesh to one closed, manifold, outward shell without crossings, or an error that says what is left."""

from scan2fea.repair.repair import Repaired, RepairOptions, repair

__all__ = ["RepairOptions", "Repaired", "repair"]
