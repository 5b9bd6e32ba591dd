"""When a smooth surface must not be shipped: what points that were held out, gaps made elsewhere and sight lines say against it."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.coverage import unmeasured_share
from scan2fea.kernel.distances import PointToMesh, signed_distance
from scan2fea.kernel.measures import area, volume
from scan2fea.reconstruction.budget import EDGES_CUT, EDGES_GROWN, GAPS, HIDDEN_VOLUME, VOLUME_IN_DOUBT, WALL_ENDS
from scan2fea.reconstruction.evidence import at_most, mm
from scan2fea.reconstruction.gates import DEVIATION_SEEN, QUIET, STRAY_SIGMAS, STRAY_SPACINGS, UNMEASURED_SEEN, in_all
from scan2fea.reconstruction.gates_planar import APART, BEND_SPACING, EXCESS
from scan2fea.reconstruction.gates_surface import deviation, stray
from scan2fea.reconstruction.hidden_volume import LIMIT, REACH, hidden_volume
from scan2fea.reconstruction.sight import Sight
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.types import Check, FloatArray, IntArray, Scan, TriangleMesh

ONE_SIDED = 0.02  # spacings, besides chance: over edges all held-out points lie on one side of a smooth surface
PLACES = 2000  # in the solid, where sight lines are asked for
ASKED_AGAIN = frozenset(
    {EDGES_CUT, EDGES_GROWN, HIDDEN_VOLUME, WALL_ENDS, VOLUME_IN_DOUBT, "deviation p95", "stray points", "unmeasured area"}
)  # fmt: skip


def gates_smooth(scan: Scan, first: Reconstruction, mesh: TriangleMesh, held_out: FloatArray, gaps_m3: float) -> tuple[Check, ...]:
    """The checks of a smooth surface. first : the surface it came from.   held_out : (n,) signed distance of each point from one without it.

    gaps_m3 : what gaps may hide, by others as wide made where points are.
    """
    cloud, h, sigma = scan.cloud, first.spacing_m, first.sigma_m
    measured = cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]
    near = PointToMesh(mesh).nearest(measured)
    off = near.distance
    body = abs(volume(mesh))
    scatter, mean = float(np.sqrt(np.mean(held_out**2))), abs(float(held_out.mean()))
    chance = 3.0 * scatter / np.sqrt(len(held_out))
    gaps, through = gaps_m3 / body, _seen_through(scan, first, mesh)
    limit, one_sided = EXCESS * sigma + BEND_SPACING * h, ONE_SIDED * h + chance
    far = STRAY_SIGMAS * sigma + STRAY_SPACINGS * h
    return in_all(
        at_most(
            "scatter of held-out points", scatter, limit,
            f"points held out lie {mm(scatter)} off the smooth surface through the others (limit {mm(limit)}): the part has edges", "m",
        ),
        at_most(
            "held-out points on one side", mean, one_sided,
            f"points held out lie {mm(mean)} on one side of the smooth surface (limit {mm(one_sided)}): the part has edges", "m",
        ),
        at_most(
            EDGES_CUT, (mean + chance) * area(mesh) / body, LIMIT,
            f"the surface may lie {mm(mean + chance)} on one side of the points between them (limit {LIMIT:.0%} of the volume): scan more densely",
        ),
        at_most(
            GAPS, gaps, LIMIT,
            f"{gaps:.1%} of the volume is open under gaps between the points, by others as wide (limit {LIMIT:.0%}): scan there too",
        ),
        at_most("solid and sight lines", through, APART, f"sight lines pass through {through:.1%} of the solid (limit {APART:.0%})"),
        *(check for check in first.checks if check.name not in ASKED_AGAIN),
        hidden_volume(mesh, near, h, border=REACH),  # what hides in gaps is told by others as wide
        _unmeasured(mesh, measured, near.face, 3.0 * (h + sigma)),
        deviation(off, DEVIATION_SEEN * (sigma + QUIET * h)),
        stray(measured, np.abs(held_out), far),
    )  # fmt: skip


def _unmeasured(mesh: TriangleMesh, points: FloatArray, face: IntArray, reach_m: float) -> Check:
    bare = unmeasured_share(mesh, points, reach_m, face)
    says = f"{bare:.0%} of the surface has no measured point of its side within {mm(reach_m)} (limit {UNMEASURED_SEEN:.0%}): scan there too"
    return at_most("unmeasured area", bare, UNMEASURED_SEEN, says)


def _seen_through(scan: Scan, first: Reconstruction, mesh: TriangleMesh) -> float:
    """Share of the volume, but for a skin in which lines may graze its faces, that sight lines pass through."""
    sight = Sight.of(scan, first)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    places = low + (high - low) * np.random.default_rng(0).random((PLACES, 3))
    depth = signed_distance(places, mesh)
    deep = places[depth < -sight.skin_m]
    return float(sight.passes(deep).sum()) / max(1, int((depth < 0).sum()))
