"""Lloyd or ODT as the last step of remeshing, where asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.predicates import self_intersections
from scan2fea.remeshing.lloyd import lloyd
from scan2fea.remeshing.odt import odt
from scan2fea.types import TriangleMesh

KINDS = ("none", "lloyd", "odt", "lloyd_free", "odt_free")
UNDONE = "undone: faces crossed"


def relaxed_by(kind: str, mesh: TriangleMesh, iterations: int, drift_m: float) -> tuple[TriangleMesh, str]:
    """The surface relaxed by one of KINDS, and what was done; `mesh` itself where faces crossed. The free kinds have no regions left."""
    if kind == "none":
        return mesh, ""
    method, constrained = (lloyd if kind.startswith("lloyd") else odt), not kind.endswith("free")
    made, found = method(mesh, iterations, drift_m=drift_m, constrained=constrained)
    if len(self_intersections(made)):
        return mesh, UNDONE
    if not constrained:
        made = replace(made, face_region=np.full(len(made.faces), -1, np.int64))
    return made, f"{kind}: {found.iterations} iterations, energy {found.energies[-1] / found.energies[0]:.4f}"
