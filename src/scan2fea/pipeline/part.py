"""What one object takes along into its own process, and what comes back."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from scan2fea.cad import Snap, Trued
from scan2fea.kernel.coverage import Deviation
from scan2fea.pipeline.dimension_doubt import PoseDoubt
from scan2fea.pipeline.route import ESTIMATION, Estimate
from scan2fea.types import BoolArray, Brep, Check, FEModel, FEResult, FloatArray, Footing, Member, Route, Scan, TetMesh, TriangleMesh, Value
from scan2fea.verification.drawing import AsBuilt


@dataclass(frozen=True, eq=False, kw_only=True)
class Part(Value):
    """One object of the scene. `mesh` is given where the input had faces: then it enters at repair and `scan` holds its vertices.

    doubt : of the places that it was seen from (`pose_doubt.doubt_of`).   smeared : why a scanner's motion is in its points, "" where it is not.
    footings : planes that it may rest on.   strips : (k, 3) points of thin objects beside it.   covers : of each other
    object or piece of clutter around it, which may lie on it.
    cut_from : number of the object that it was cut out of, as one of its members; 0 of none.   meets : (k, 3) points of each of the others.
    """

    id: int
    kind: str
    scan: Scan
    mesh: TriangleMesh | None = None
    doubt: PoseDoubt = field(default_factory=PoseDoubt)
    smeared: str = ""
    footings: tuple[Footing, ...] = ()
    strips: tuple[FloatArray, ...] = ()
    covers: tuple[FloatArray, ...] = ()
    cut_from: int = 0
    meets: tuple[FloatArray, ...] = ()

    @property
    def contact(self) -> BoolArray:
        """(n,) inferred points on the face that it rests on: they come from no input."""
        cloud = self.scan.cloud
        return np.zeros(len(cloud), bool) if cloud.is_inferred is None else np.asarray(cloud.is_inferred & (cloud.frame < 0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Against(Value):
    """A drawing laid onto what was measured. points : (n, 3) these.   T_scene_drawing : (4, 4).   drawing : the drawn solid where the part is.

    tolerance_source : who says what its faces may be off.
    """

    points: FloatArray
    T_scene_drawing: FloatArray
    drawing: Trued
    found: AsBuilt
    tolerance_source: str


@dataclass
class Made:
    """What has been made of one object so far; the only mutable thing of the chain, so that a failure keeps what came before it."""

    part: Part
    route: Route | None = None
    estimate: Estimate | None = None  # what estimation said, whichever way was taken
    surface: TriangleMesh | None = None  # the latest surface; in the end the boundary of the tets
    sheet: TriangleMesh | None = None  # what was measured, where no solid came out
    spacing_m: float = 0.0
    sigma_m: float = 0.0
    residual_m: float | None = None  # noise left in the surface, where less than that of the points
    sensor: str = "unknown"
    carried: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))  # places on hidden faces of walls that reconstruction put there
    how: dict[str, Any] = field(default_factory=dict)
    deviation: Deviation | None = None
    brep: Brep | None = None
    snaps: tuple[Snap, ...] = ()  # relations between its true faces that were tested
    tets: TetMesh | None = None
    model: FEModel | None = None
    result: FEResult | None = None
    drawing: Against | None = None  # the drawing it is compared with, laid onto its points
    drawn_row: dict[str, Any] = field(default_factory=dict)  # its file, what both were solved for, why it was not compared
    checks: list[Check] = field(default_factory=list)
    refused: list[Check] = field(default_factory=list)  # those of a member that explains the points but is not known well enough to be built
    supported_share: float = 0.0  # of the area: not seen, but on a plane that was, or the other face of a wall that was
    drift: list[dict[str, Any]] = field(default_factory=list)
    places: FloatArray | None = None  # where the thickness is followed through the steps
    thickness: list[FloatArray] = field(default_factory=list)  # one per step of the drift ledger
    handles: list[int] = field(default_factory=list)  # holes that go through, likewise
    stopped: str = ""  # why the chain ended early

    @property
    def member(self) -> Member | None:
        """The member that the object was built as; None where its surface was reconstructed or given."""
        is_built = self.route is not None and self.route.name == ESTIMATION and self.estimate is not None
        return self.estimate.member if is_built and self.estimate is not None else None
