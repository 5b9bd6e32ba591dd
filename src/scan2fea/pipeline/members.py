"""The way of a member: fitted, checked, and built as the solid that it is; no triangles between the points and the model."""

from __future__ import annotations

import numpy as np

from scan2fea.cad import Drilled, drilled, prism_brep
from scan2fea.estimation.given import contradictions
from scan2fea.estimation.layers import layers_of
from scan2fea.estimation.solid import Solid, solid_of
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.outline import Edge, Outline
from scan2fea.pipeline.assigned import own_section
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.drift import moved
from scan2fea.pipeline.part import Made, Part
from scan2fea.pipeline.record import Record, Tracked
from scan2fea.pipeline.route import ESTIMATION, RECONSTRUCTION, Estimate, estimate, route_of
from scan2fea.tetmeshing import Filled, FillOptions, fill, layered
from scan2fea.types import Brep, Member, Route, TetMesh
from scan2fea.verification.given import given_checks
from scan2fea.verification.member import bare_wall_checks, length_checks, member_checks, strip_checks

GIVEN = "the input has faces: it enters at repair"
ASKED = "free form: route.mode asks for it"


def choose_route(made: Made, source: Tracked[Part], config: Config, record: Record) -> Tracked[Member] | None:
    """Enter the route into `made`; the member where it is to be built. One that is not known well enough is reconstructed instead."""
    part, mode = source.value, config.route.mode
    if part.mesh is not None or mode == RECONSTRUCTION:
        made.route = Route(name="reconstruction", reason=GIVEN if part.mesh is not None else ASKED)
        return None
    own = own_section(config.object, part.id)
    around = {"doubt": part.doubt, "footings": part.footings, "strips": part.strips, "covers": part.covers, "meets": part.meets}
    scan, known = Tracked(part.scan, source.key), {"route": config.route, "known": own, "root_radius_m": config.solid.root_radius_m, **around}
    found = record("estimate", estimate, scan, options=config.estimation, extra=known, n_in=len(part.scan.cloud), count=_n_told)
    made.estimate, made.route = found.value, route_of(found.value, mode)
    made.checks += strip_checks(found.value.strip)
    member = made.member
    if member is None:
        return None
    named = bool(config.route.member or config.estimation.family or (own is not None and own.family))
    open_end = found.value.open_end
    checks = (
        *member_checks(member, found.value.explains, given=named, open_end=open_end),
        *bare_wall_checks(found.value.bare_share),
        *given_checks(found.value.n_contradicted),
    )
    failed = [check for check in checks if not check.passed]
    if failed and mode != ESTIMATION:
        denied = contradictions(found.value.given)
        why = f"free form, because as a member of family {member.family}: {failed[0].says}" + (f"; {denied}" if denied else "")
        made.route, made.refused = Route(name="reconstruction", reason=why), list(checks)
        made.checks += length_checks(open_end)  # free form would close it there
        return None
    made.checks += checks
    return Tracked(member, found.key)


def told_after_all(made: Made, stopped: str) -> str:
    """A member that was given up for free form is told where free form did not serve either: what is known of it, and what it lacks.

    stopped : why the chain ended, "" where it did not. Returns that of the object: of the member.
    """
    estimated = made.estimate
    if not made.refused or estimated is None or not (stopped or any(not check.passed for check in made.checks)):
        return stopped
    free = stopped or next(check.says for check in made.checks if not check.passed)
    made.route = Route(name="estimation", reason=f"{estimated.reason}; free form does not serve either: {free}")
    told = {check.name for check in made.refused}
    made.checks = [*made.refused, *(check for check in made.checks if check.name not in told)]
    return ""


def _n_told(found: Estimate) -> int:
    """Dimensions that the points tell."""
    return 0 if found.member is None else sum(p.observable for p in found.member.parameters)


def build_member(made: Made, member: Tracked[Member], config: Config, record: Record) -> Tracked[TetMesh]:
    """Solid, B-Rep and tets of the fitted member, entered into `made`."""
    scan = made.part.scan
    made.spacing_m, made.sigma_m = spacing(scan.cloud.points), member.value.sigma_m
    made.sensor = "known" if np.isfinite(scan.sensors()).all() else "unknown"
    solid = record("member", solid_of, member, options=config.solid, n_in=len(member.value.parameters), count=lambda s: len(s.face_names))
    n = len(solid.value.face_names)
    if member.value.holes:
        return _drilled(made, solid, member, config, record)
    moved(made, "member", solid.value.mesh)
    brep = record("solid", _brep, solid, n_in=n, count=lambda b: len(b.face_names))
    made.brep = brep.value
    tets = record("tets", _tets, solid, n_in=n, count=lambda t: len(t.tets))
    made.tets = tets.value
    return tets


def _drilled(made: Made, solid: Tracked[Solid], member: Tracked[Member], config: Config, record: Record) -> Tracked[TetMesh]:
    """The same with the holes of the member. Its tets follow the chamfers that stand for fillets, as without holes, and the cylinders."""
    n = len(solid.value.face_names) + len(member.value.holes)
    brep = record("solid", _with_holes, solid, member, n_in=n, count=_n_faces)
    made.brep = brep.value.brep
    shape = record("holes", _chamfered, solid, member, n_in=n, count=_n_faces)
    moved(made, "member", shape.value.mesh)
    filled = record("tets", _fill, shape, options=config.tetmeshing, n_in=n, count=lambda f: len(f.tets.tets))
    made.how.update(filled.value.how)
    made.tets = filled.value.tets
    return Tracked(filled.value.tets, filled.key)


def _n_faces(found: Drilled) -> int:
    return len(found.brep.face_names)


def _with_holes(solid: Solid, member: Member) -> Drilled:
    return drilled(_brep(solid), member.holes)


def _chamfered(solid: Solid, member: Member) -> Drilled:
    """Solid with holes of the polygons that the mesh of a member sweeps."""
    loops = []
    for points, names in zip(solid.loops, solid.loop_names, strict=True):
        ends = zip(names, points, np.roll(points, -1, axis=0), strict=True)
        loops.append(tuple(Edge(name=name, start=start, end=end) for name, start, end in ends))
    return drilled(prism_brep(Outline(family=solid.shape.family, loops=tuple(loops)), solid.mesh_sweep), member.holes)


def _fill(shape: Drilled, options: FillOptions) -> Filled:
    return fill(shape.mesh, shape.brep, options)


def _brep(solid: Solid) -> Brep:
    return prism_brep(solid.shape, solid.sweep)


def _tets(solid: Solid) -> TetMesh:
    at = layers_of(solid)
    return layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names)
