"""What rays say that the density of their points cannot: whether neighbours show a surface at all, and where a face was shot through.

The points of one ring of a rotating LiDAR scatter along their rays, in the cone that the beam sweeps. Where rings stand farther apart than that
noise, neighbours lie in the cone and not in the surface: their plane, their scatter and the empty places between them are the sensor's.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.special import bdtrc

from scan2fea.estimation.explain import AGAIN, MAX_CROWD, TOLERANCE, ByRays
from scan2fea.estimation.holes import VOID_CELLS, VOID_POINTS, on_faces
from scan2fea.estimation.outline import outline_distance
from scan2fea.estimation.solid import swept
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.noise import QUANTILE, sampled_rows
from scan2fea.kernel.normals import normals_at
from scan2fea.kernel.rays import RayScene, first_hits, scene_of
from scan2fea.kernel.sections import ROUND, section
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Scan, Section

_NEIGHBOURS = 12
_POINTS = 2_000
_EDGE_ON = 0.26  # |cosine| of ray and normal: 75 degrees, where hardly a ray comes back from a surface
_REACH = 6.0  # sigma beyond which a return is not of the member
_A_CELL = 6.0  # rays aimed at a cell, on average
_SIGMAS = 4.0  # and mill tolerance: what lies no deeper than that may be on the face, and what passes no farther from a corner beside it
_ASKED = 200_000  # rays
_FACING = 0.9  # cosine between the two faces of a wall
_TOGETHER = (4, 8, 16, 32, 64)  # rays of one place, that are asked together
_CHANCE = 1e-6  # that strays pass a wall together


def in_sheets(scan: Scan, seed: int = 0) -> bool:
    """Whether most points lie in planes that hold their own rays. False where rays are not known."""
    across = _facing(scan, seed)
    return len(across) > 0 and bool(np.mean(across < _EDGE_ON) > 0.5)


def _facing(scan: Scan, seed: int) -> FloatArray:
    """(m,) |cosine| between rays and the normal of the neighbours of their points, of a draw of these; none where rays are not known."""
    known = np.flatnonzero(scan.cloud.ray >= 0)
    if scan.rays is None or len(known) <= _NEIGHBOURS:
        return np.zeros(0)
    points = scan.cloud.points[known]
    some = sampled_rows(len(points), _POINTS, seed)
    normal = normals_at(points[some], points, _NEIGHBOURS)
    way = scan.rays.direction[scan.cloud.ray[known[some]]]
    return np.asarray(np.abs(np.einsum("ni,ni->n", normal, way)))


def shot_through(scan: Scan, member: Member, sigma_m: float) -> int:
    """Number of holes: places within a face at which rays were aimed that nothing stopped before, most of which passed. 0 where rays are not known.

    sigma_m : of the range.
    """
    if scan.rays is None:
        return 0
    origin, way, reach = scan.rays.origin, scan.rays.direction, scan.rays.range_m
    entry, _ = first_hits(scene_of(swept(member)), origin, way)
    aimed = np.isfinite(entry) & ~(reach < entry - _REACH * sigma_m)
    at = sweep_of_member(member).coordinates(origin[aimed] + entry[aimed, None] * way[aimed])
    passed = ~(reach[aimed] <= entry[aimed] + _REACH * sigma_m)
    shape, length = section(member.family, member.values()), member.values()["length"]
    _, edge, along = outline_distance(shape, at[:, :2])
    return sum(_holes(s, at[rows, 2], passed[rows], width, length) for _, rows, s, width in on_faces(shape, edge, along))


def seen_through(scan: Scan, member: Member, seed: int = 0) -> str:
    """Why rays deny the member: more points than may be a second body lie behind a wall of it, as seen from the sensor, or some of one place do; ""
    where not or not known.

    An open section whose lips were seen looks like a tube whose wall is bare between them: what was measured within was measured through that wall.
    """
    known = np.flatnonzero(scan.cloud.ray >= 0)
    if scan.rays is None or len(known) == 0:
        return ""
    rows = scan.cloud.ray[known[sampled_rows(len(known), _ASKED, seed)]]
    origin, way, reach = scan.rays.origin[rows], scan.rays.direction[rows], scan.rays.range_m[rows]
    solid, shape = swept(member), section(member.family, member.values())
    scene, normals = scene_of(solid), face_normals(solid)
    entry, face = first_hits(scene, origin, way)
    off = _SIGMAS * member.sigma_m + TOLERANCE * float(np.linalg.norm(np.ptp(np.concatenate(shape.loops), axis=0)))
    met = np.flatnonzero(np.isfinite(entry))
    origin, way, reach, entry, face = origin[met], way[met], reach[met], entry[met], face[met]
    places = origin + entry[:, None] * way
    at = sweep_of_member(member).coordinates(places)
    along = np.minimum(at[:, 2], member.values()["length"] - at[:, 2])
    clear = (along > off) & (_from_corners(shape, member.family, at[:, :2]) > off)
    beyond = (reach - entry) * np.abs(np.einsum("ni,ni->n", normals[face], way))
    share = float((clear & (beyond > off)).sum()) / len(rows)
    if share > MAX_CROWD:
        return (
            f"{share:.0%} of the points (limit {MAX_CROWD:.0%}) lie behind a wall of the {member.family} member, as seen from where they were "
            "measured: there is no wall where their rays passed"
        )
    passed, deep = np.zeros(len(met), bool), np.flatnonzero(clear & (beyond > off))
    passed[deep] = _past_walls(scene, normals, member, places[deep], way[deep], (reach - entry)[deep], face[deep], off)
    aimed = clear & (beyond > -off)  # nothing before it hides the wall
    return _one_place(places[aimed], at[aimed, 2], passed[aimed], member)


def _past_walls(
    scene: RayScene, normals: FloatArray, member: Member, places: FloatArray, way: FloatArray, deep: FloatArray, face: IntArray, off: float
) -> BoolArray:
    """(n,) were points measured on another face of the member, on the far side of the wall that their rays enter at places (n, 3)?

    deep : (n,) m, along the ray.   face : (n,) triangle entered.   A dent leads into the wall and stays there; what passes by a rounded corner leaves
    the solid by the next face.
    """
    skin = 1e-3 * off
    thick, out = first_hits(scene, places + skin * way, way)
    wall = (out >= 0) & (np.einsum("ni,ni->n", normals[face], normals[out]) < -_FACING)
    wall &= (deep - skin - thick) * np.abs(np.einsum("ni,ni->n", normals[out], way)) > off
    shape = section(member.family, member.values())
    ends = sweep_of_member(member).coordinates(places + deep[:, None] * way)
    return np.asarray(wall & (np.abs(outline_distance(shape, ends[:, :2])[0]) < off))


def _one_place(places: FloatArray, along: FloatArray, passed: BoolArray, member: Member) -> str:
    """Where more rays of those aimed at one place, places (n, 3), passed a wall than chance lets strays do; "" where nowhere."""
    rays = np.flatnonzero(passed)
    if len(rays) < _TOGETHER[0]:
        return ""
    tree, best, says = cKDTree(places), math.log(_CHANCE / (len(rays) * len(_TOGETHER))), ""
    for n in (n for n in _TOGETHER if n <= len(places)):
        distance, near = map(np.asarray, tree.query(places[rays], n))
        gone = passed[near].sum(axis=1)
        with np.errstate(divide="ignore"):
            chance = np.log(bdtrc(gone - 1, n, len(rays) / len(places)))
        k = int(np.argmin(chance))
        if chance[k] < best:
            best = float(chance[k])
            says = (
                f"{gone[k]} of {n} rays that were aimed at one place of a wall of the {member.family} member ({1e3 * distance[k, -1]:.3g} mm around, "
                f"{along[rays[k]]:.3f} m along it) were stopped by the wall beyond: there is a hole, and the member has none"
            )
    return says


def _from_corners(shape: Section, family: str, xy: FloatArray) -> FloatArray:
    """(n,) distance of places (n, 2) in the section to its nearest corner, m; a circle has none."""
    if family in ROUND:
        return np.full(len(xy), np.inf)
    return np.asarray(np.linalg.norm(xy[:, None] - np.concatenate(shape.loops)[None], axis=2).min(axis=1))


def told_by_rays(scan: Scan, member: Member, sigma_m: float, seed: int = 0, *, misses_known: bool = True) -> ByRays:
    """What `explanation` is told of a member that was fitted to rays: holes, and where the rays that hit would measure it. sigma_m : of the range."""
    sheets = in_sheets(scan, seed)
    asked = misses_known or sheets  # what was hit behind a hole tells of it, and the gaps between rings tell nothing
    voids = shot_through(scan, member, sigma_m) if asked else None
    facing = 0.0 if sheets else float(np.quantile(_facing(scan, seed), QUANTILE))
    return ByRays(voids=voids, again=_measured_again(scan, member, sigma_m, seed), facing=facing)


def _measured_again(scan: Scan, member: Member, sigma_m: float, seed: int) -> FloatArray:
    """(m, 2) in the section: each ray of a point that meets the member, AGAIN times, with noise along it."""
    if scan.rays is None:
        return np.zeros((0, 2))
    rows = scan.cloud.ray[scan.cloud.ray >= 0]
    origin, way = scan.rays.origin[rows], scan.rays.direction[rows]
    entry, _ = first_hits(scene_of(swept(member)), origin, way)
    met = np.repeat(np.flatnonzero(np.isfinite(entry)), AGAIN)
    reach = entry[met] + sigma_m * np.random.default_rng([seed, 9]).standard_normal(len(met))
    return np.asarray(sweep_of_member(member).coordinates(origin[met] + reach[:, None] * way[met])[:, :2])


def _holes(s: FloatArray, z: FloatArray, passed: BoolArray, width: float, length: float) -> int:
    """Enclosed regions of cells of a face where most rays passed."""
    cell = np.sqrt(width * length * _A_CELL / max(len(s), 1))
    n_s, n_z = round(width / cell), min(round(length / cell), 2000)
    if min(n_s, n_z) < VOID_CELLS:
        return 0
    i = np.clip((s / width * n_s).astype(int), 0, n_s - 1)
    j = np.clip((z / length * n_z).astype(int), 0, n_z - 1)
    aimed = np.bincount(i * n_z + j, minlength=n_s * n_z).reshape(n_s, n_z)
    gone = np.bincount(i * n_z + j, weights=passed.astype(float), minlength=n_s * n_z).reshape(n_s, n_z)
    label, n_regions = ndimage.label(2 * gone > aimed)
    rim = np.unique(np.r_[label[0], label[-1], label[:, 0], label[:, -1]])
    regions = [k for k in range(1, n_regions + 1) if k not in rim]
    return sum(bool((label == k).sum() >= VOID_CELLS and aimed[label == k].sum() > VOID_POINTS) for k in regions)
