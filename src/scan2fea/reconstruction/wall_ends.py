"""Ends of walls on which nothing was measured: there the wall may go on, and only the scan end.

Points missing on both sides of a wall leave a hole whose border is narrow: it lies within a few spacings of measured points everywhere, and
hides little by its own area. But a border that was seen has points of its own, as many for its area as the faces beside it, and they lie between
these. So where triangles lead from one face of a wall straight to the other for longer than chance lets them, nothing was seen; unless a sight line
passes there. That says something of the scan, not of one answer to it: a second answer with its surface in the same places has the same ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.face_tree import morton_order
from scan2fea.kernel.jit import jit
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.noise import SPACING_NEIGHBORS
from scan2fea.kernel.topology import edge_table
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.evidence import Ends, Evidence, around, at_most, wall_m
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh, Value

LIMIT = 0.02  # of the volume: as behind surface that no ray has met
OPPOSITE, ALIKE = -0.5, 0.8  # cosine between normals of the two faces of a wall, and of one of them
FLAT = 0.9  # a triangle whose corners agree better is not looked at
BETWEEN, MOST_BETWEEN = 0.15, 0.35  # of the wall's thickness below either face, besides the noise: between them
NEIGHBORS, LEAST = 24, 3  # points that tell on which face one lies, and how many must agree
DENSITY = 0.85  # points per squared spacing of a random sample
EXPECTED = 6.0  # points due between the faces on a stretch that has none: chance 0.0025 at the density of the faces beside it, 0.05 at half of it
NEIGHBOURING, JOINED = 2.0, 2.0  # points due, and spacings between them, of shorter stretches that go on beyond a point or a bend
FLAT_END, FACES_SO = 0.7, 0.7  # length of the mean normal of a stretch that lies in a plane; cosine of others that do
BEYOND = 1.5  # spacings beyond a wall's end, at least its thickness: where it would go on
STEPS = (0.25, 0.5, 1.0)  # of that distance: where a sight line is asked for; the wall may go on as far as the first that has one
IN_WALL = 0.25  # of its thickness off the middle of a wall: a sight line farther off may pass beside a wall that bends
ON = 0.25  # spacings, besides the noise, from a surface that lies on a place
BLOCK, ROUNDED = 32, 1e-12  # places that lines are held against together; what rounding leaves of the squared distance to an origin
WHOLE_END = 0.5  # of the area in that plane: with more of it unseen the part may go on there


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretch(Value):
    """Faces that lead across a wall with no point between.   faces : (k,).   wall_m : thickness.   length_m : along the end.   due : points.

    slack_m : (k,) distance beyond each face at which a sight line passes, inf: none.
    """

    faces: IntArray
    wall_m: float
    length_m: float
    due: float
    slack_m: FloatArray


def wall_ends(evidence: Evidence, limit: float = LIMIT) -> Check:
    """How much may hide beyond ends of walls without points?

    An end of length P round a hole encloses at most P^2 / (4 pi) of wall, at an edge twice that, at a corner four times; where more than half of an
    end that the whole part lies behind has no points, anything may be beyond. Where sight lines pass beyond an end it may reach as far as these.
    """
    return told_ends(evidence, *stretches(evidence), limit)


def told_ends(evidence: Evidence, unproved: list[Stretch], every: list[Stretch], limit: float = LIMIT) -> Check:
    """As `wall_ends`, of the ends that `stretches` has found."""
    before = (_still_there(ends, evidence.mesh, evidence.spacing_m, evidence.sigma_m) for ends in evidence.ends_before)
    return _told(max((_hidden(evidence, unproved, every), *before), key=lambda ends: ends.share), limit)


def ends_left(ends: tuple[Ends, ...], mesh: TriangleMesh, spacing_m: float, sigma_m: float) -> Check:
    """How much may hide beyond the ends of walls that other surfaces through the same points had, where this one has them too?"""
    return _told(max((_still_there(own, mesh, spacing_m, sigma_m) for own in ends), key=lambda own: own.share), LIMIT)


def _told(ends: Ends, limit: float) -> Check:
    says = (
        f"{ends.share:.0%} of the volume may hide beyond ends of walls where no point was measured (limit {limit:.0%}){around(ends.places)}: "
        "the scan may end there, not the wall; scan the edges too, or fit the member"
    )
    return at_most(WALL_ENDS, ends.share, limit, says)


def unseen_ends(evidence: Evidence) -> Ends:
    """The ends of walls of this surface on which nothing was measured."""
    return _hidden(evidence, *stretches(evidence))


def _hidden(evidence: Evidence, unproved: list[Stretch], every: list[Stretch]) -> Ends:
    mesh = evidence.mesh
    body, normals, areas = abs(volume(mesh)), face_normals(mesh), face_areas(mesh)
    hidden, where = list[float](), list[FloatArray]()
    for stretch in every:
        ends = np.isfinite(stretch.slack_m)
        if ends.any():
            hidden.append(float(areas[stretch.faces[ends]] @ stretch.slack_m[ends]))
            where.append(mesh.vertices[mesh.faces[stretch.faces[ends]]].mean(axis=1))
    for stretch in unproved:
        endless = ends_part(stretch.faces, mesh, normals, areas, stretch.wall_m + JOINED * evidence.spacing_m)
        hidden.append(body if endless else stretch.wall_m * stretch.length_m**2 / math.pi)
        where.append(mesh.vertices[mesh.faces[stretch.faces]].mean(axis=1))
    return Ends(
        shares=np.array(hidden) / body if body > 0.0 else np.zeros(len(hidden)),
        places=np.concatenate([np.zeros((0, 3)), *where]),
        of=np.repeat(np.arange(len(where)), [len(places) for places in where]),
    )


def _still_there(ends: Ends, mesh: TriangleMesh, spacing_m: float, sigma_m: float) -> Ends:
    """What these ends tell where a surface lies on them too: what may hide goes with the square of their length.

    A surface that closes a notch, or opens it farther, leaves them.
    """
    on = PointToMesh(mesh).nearest(ends.places).distance <= ON * spacing_m + sigma_m
    n = len(ends.shares)
    part = np.bincount(ends.of, on, n) / np.maximum(np.bincount(ends.of, minlength=n), 1)
    return Ends(shares=ends.shares * part**2, places=ends.places[on], of=ends.of[on])


def stretches(evidence: Evidence) -> tuple[list[Stretch], list[Stretch]]:
    """Ends of walls that were due EXPECTED points and have none: those beyond which no sight line passes, and all."""
    mesh, wall = evidence.mesh, wall_m(evidence)
    corner = k_nearest(evidence.smoothed, 1, mesh.vertices)[1][:, 0][mesh.faces]
    normal = evidence.normals[corner]
    bent = np.einsum("fkc,fkc->fk", normal, np.roll(normal, -1, axis=1)).min(axis=1) < FLAT
    points = np.unique(corner[bent])
    if not math.isfinite(wall) or not len(points):
        return [], []
    skin = _skin(evidence, wall)
    sheets = np.full_like(evidence.normals, np.nan)
    sheets[points] = _sheet_normals(evidence, points, skin * wall)
    normal = sheets[corner]
    turned = np.einsum("fkc,fkc->fk", normal, np.roll(normal, -1, axis=1))
    across = np.flatnonzero(np.isfinite(turned).all(axis=1) & (np.nan_to_num(turned).min(axis=1) < OPPOSITE))
    far = _far_side(normal[across])
    bare = across[~_has_points(evidence, across, far, skin)]
    due = (1.0 - 2.0 * skin) * DENSITY * face_areas(mesh) / np.median(_spacing(evidence, points)[corner], axis=1) ** 2
    thick = np.column_stack([evidence.thickness_m[corner], _span(mesh.vertices[mesh.faces], normal)])
    slack = np.full(len(mesh.faces), math.inf)
    every = _gathered(evidence, bare, due, thick, slack)
    if not every:
        return [], []
    asked = np.concatenate([stretch.faces for stretch in every])  # a stretch without some of its faces is part of it: no other one needs its lines
    slack[asked] = _slack(evidence, asked, normal[asked, 0], _far_side(normal[asked]), wall)
    if np.isinf(slack[asked]).all():
        return every, every
    return _gathered(evidence, bare[np.isinf(slack[bare])], due, thick, slack), _gathered(evidence, bare, due, thick, slack)


def points_due(evidence: Evidence) -> FloatArray:
    """(m,) points due on each face by how close they lie round its corners."""
    corner = k_nearest(evidence.smoothed, 1, evidence.mesh.vertices)[1][:, 0][evidence.mesh.faces]
    apart = np.median(_spacing(evidence, np.unique(corner))[corner], axis=1)
    return np.asarray(DENSITY * face_areas(evidence.mesh) / apart**2)


def _spacing(evidence: Evidence, rows: IntArray) -> FloatArray:
    """(n,) distance between points round each at some rows, inf elsewhere; where sensors are known the median of what its neighbours have.

    At the border of a gap a point has neighbours on one side only, farther off by the root of two: as if points lay half as dense. Without sight
    lines, which prove ends that chance left bare, that is left as a margin.
    """
    places, own = evidence.smoothed, np.full(len(evidence.smoothed), math.inf)
    if evidence.sensors is None:
        own[rows] = k_nearest(places, SPACING_NEIGHBORS + 1, places[rows])[0][:, 1:].mean(axis=1)
        return own
    near = k_nearest(places, SPACING_NEIGHBORS + 1, places[rows])[1]
    asked = np.unique(near)
    own[asked] = k_nearest(places, SPACING_NEIGHBORS + 1, places[asked])[0][:, 1:].mean(axis=1)
    out = np.full(len(places), math.inf)
    out[rows] = np.median(own[near], axis=1)
    return out


def _span(corners: FloatArray, normal: FloatArray) -> FloatArray:
    """(m,) how far the corners (m, 3, 3) of each face lie apart along the normal of the first one's sheet: across a wall its thickness."""
    return np.asarray(np.ptp(np.einsum("fkc,fc->fk", corners, normal[:, 0]), axis=1))


def _skin(evidence: Evidence, wall: float) -> float:
    """Share of the wall below either face in which a point does not lie between them."""
    return min(MOST_BETWEEN, BETWEEN + evidence.sigma_m / wall)


def _gathered(evidence: Evidence, bare: IntArray, due: FloatArray, thick: FloatArray, slack: FloatArray) -> list[Stretch]:
    """Bare faces in stretches of which one piece was due EXPECTED points. due, slack : (m,) of all faces.

    thick : (m, 4) wall at corners, nan where not known, and how far a face leads across.
    """
    mesh = evidence.mesh
    pieces = [piece for piece in joined(mesh.faces, bare) if due[piece].sum() >= NEIGHBOURING]
    if not pieces:
        return []
    of = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    group = _near_each_other(mesh.vertices[mesh.faces[np.concatenate(pieces)]].reshape(-1, 3), np.repeat(of, 3), JOINED * evidence.spacing_m)
    out = []
    for number in np.unique(group):
        own = [piece for piece, its in zip(pieces, group, strict=True) if its == number]
        if max(due[piece].sum() for piece in own) < EXPECTED:
            continue
        faces = np.concatenate(own)
        areas = face_areas(mesh)[faces]
        across_m = _across_m(thick[faces], areas, evidence.spacing_m)
        length = float(areas.sum()) / across_m
        out.append(Stretch(faces=faces, wall_m=across_m, length_m=length, due=float(due[faces].sum()), slack_m=slack[faces]))
    return out


def _across_m(thick: FloatArray, areas: FloatArray, spacing_m: float) -> float:
    """Thickness of the wall that faces lead across, at least a spacing, m.   thick : (k, 4) as in `_gathered`.

    Skins nearer to each other than a spacing are a fold of the surface at the border of a gap and no wall: there half of the area tells it, by how
    far it leads across.
    """
    known = thick[:, :3][np.isfinite(thick[:, :3])]
    wall = float(np.median(known)) if len(known) else 0.0
    if wall < spacing_m:
        order = np.argsort(thick[:, 3], kind="stable")
        total = np.cumsum(areas[order])
        wall = float(thick[order[np.searchsorted(total, 0.5 * total[-1])], 3])
    return max(wall, spacing_m)


def _sheet_normals(evidence: Evidence, rows: IntArray, off_m: float) -> FloatArray:
    """(k, 3) normal of the face each point lies on, nan where it lies on none of those beside it: then it is between two.

    The last points of a face have bent normals of their own, so it is told by others: of those whose planes pass within `off_m`, that
    which most others agree with.
    """
    near = k_nearest(evidence.smoothed, NEIGHBORS + 1, evidence.smoothed[rows])[1]
    normal = evidence.normals[near]
    height = np.einsum("nkc,nkc->nk", evidence.smoothed[near] - evidence.smoothed[rows][:, None], normal)
    holds = (np.abs(height) <= off_m) & (near != rows[:, None])
    agree = ((np.einsum("nic,njc->nij", normal, normal) > ALIKE) & holds[:, None, :]).sum(axis=2) * holds
    best = agree.argmax(axis=1)[:, None]
    out = np.take_along_axis(normal, best[..., None], axis=1)[:, 0]
    return np.where(np.take_along_axis(agree, best, axis=1) >= LEAST, out, np.nan)


def _far_side(normals: FloatArray) -> FloatArray:
    """(k, 3) 1 at corners that face against the first corner of each face, else 0."""
    return np.asarray(np.einsum("fkc,fc->fk", normals, normals[:, 0]) < 0, float)


def _has_points(evidence: Evidence, faces: IntArray, far: FloatArray, skin: float) -> BoolArray:
    """(k,) faces on which a measured point lies between the two faces of the wall."""
    near = evidence.nearest_backed
    place = np.full(len(evidence.mesh.faces), -1)
    place[faces] = np.arange(len(faces))
    at = place[near.face]
    on = at >= 0
    share = np.einsum("ij,ij->i", near.weights[on], far[at[on]])
    between = np.minimum(share, 1.0 - share) >= skin
    return np.asarray(np.bincount(at[on][between], minlength=len(faces)) > 0)


def _slack(evidence: Evidence, faces: IntArray, sheet: FloatArray, far: FloatArray, wall: float) -> FloatArray:
    """(k,) how far beyond each face a sight line first passes where the wall would go on, its point lying farther away; inf: nowhere asked, m.

    sheet : (k, 3) normal of the wall at each face.   far : (k, 3) 1 at the corners on its other side. It is asked for in the middle of the wall and
    along it: beside a slanting face, or one near a side of the wall, lines pass that graze the wall.
    """
    out = np.full(len(faces), math.inf)
    if evidence.sensors is None or not len(faces):
        return out
    known = np.flatnonzero(np.isfinite(evidence.sensors).all(axis=1))
    origin, target = np.ascontiguousarray(evidence.sensors[known]), np.ascontiguousarray(evidence.points[known])
    sides = [np.where(side.any(axis=1, keepdims=True), side, 1.0) for side in (far, 1.0 - far)]
    sides = [side / side.sum(axis=1, keepdims=True) for side in sides]
    middle = np.einsum("fk,fkc->fc", 0.5 * (sides[0] + sides[1]), evidence.mesh.vertices[evidence.mesh.faces[faces]])
    way = face_normals(evidence.mesh)[faces]
    way = way - np.einsum("fc,fc->f", way, sheet)[:, None] * sheet
    way /= np.maximum(np.linalg.norm(way, axis=1), np.finfo(float).tiny)[:, None]
    for step in STEPS:
        beyond = step * max(wall, BEYOND * evidence.spacing_m)
        left = np.flatnonzero(np.isinf(out))
        out[left[passed(middle[left] + beyond * way[left], origin, target, IN_WALL * wall)]] = beyond
    return out


def passed(places: FloatArray, origin: FloatArray, target: FloatArray, near: float) -> BoolArray:
    """(k,) places within `near` of a line from an origin to its target, and nearer to the origin by more than twice that."""
    out = np.zeros(len(places), np.bool_)
    if len(places):
        order = morton_order(places)
        out[order] = _passed(np.ascontiguousarray(places[order]), origin, target, near)
    return out


@jit
def _passed(places: FloatArray, origin: FloatArray, target: FloatArray, near: float) -> BoolArray:
    """As `passed`. Each line is held against the ball round a block of places first: most pass all of them by."""
    out = np.zeros(len(places), np.bool_)
    ball = np.zeros(3)
    for begin in range(0, len(places), BLOCK):
        end = min(begin + BLOCK, len(places))
        radius2 = 0.0
        for k in range(3):
            ball[k] = places[begin:end, k].mean()
        for p in range(begin, end):
            radius2 = max(radius2, (places[p, 0] - ball[0]) ** 2 + (places[p, 1] - ball[1]) ** 2 + (places[p, 2] - ball[2]) ** 2)
        radius = math.sqrt(radius2)
        left = end - begin
        for r in range(len(origin)):
            x, y, z = target[r, 0] - origin[r, 0], target[r, 1] - origin[r, 1], target[r, 2] - origin[r, 2]
            u, v, w = ball[0] - origin[r, 0], ball[1] - origin[r, 1], ball[2] - origin[r, 2]
            length2, along, apart2 = x * x + y * y + z * z, x * u + y * v + z * w, u * u + v * v + w * w
            if not length2 > 0.0 or apart2 * length2 - along * along > ((near + radius) ** 2 + ROUNDED * apart2) * length2:
                continue
            length = math.sqrt(length2)
            for p in range(begin, end):
                if out[p]:
                    continue
                u, v, w = places[p, 0] - origin[r, 0], places[p, 1] - origin[r, 1], places[p, 2] - origin[r, 2]
                at = (x * u + y * v + z * w) / length
                if 0.0 < at < length - 2.0 * near and u * u + v * v + w * w - at * at <= near * near:
                    out[p] = True
                    left -= 1
            if left == 0:
                break
    return out


def joined(faces: IntArray, chosen: IntArray) -> list[IntArray]:
    """The chosen faces in sets that hang together by edges."""
    if not len(chosen):
        return []
    twin = edge_table(faces).twin.reshape(-1, 3) // 3
    place = np.full(len(faces), -1)
    place[chosen] = np.arange(len(chosen))
    other = place[twin[chosen]]
    one, side = np.nonzero(other >= 0)
    graph = coo_array((np.ones(len(one), np.int8), (one, other[one, side])), shape=(len(chosen), len(chosen)))
    part = connected_components(graph, directed=False)[1]
    order = np.argsort(part, kind="stable")
    return np.split(chosen[order], np.cumsum(np.bincount(part))[:-1])


def _near_each_other(places: FloatArray, of: IntArray, reach_m: float) -> IntArray:
    """Group of each set of places; `of` names the set of each place, from 0. Sets with places within reach are one group."""
    near = radius_components(places, reach_m)
    n = int(of.max()) + 1
    graph = coo_array((np.ones(len(of), np.int8), (of, n + near)), shape=(n + int(near.max()) + 1,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1][:n], np.int64)


def ends_part(own: IntArray, mesh: TriangleMesh, normals: FloatArray, areas: FloatArray, rough_m: float, reach_m: float = 0.0) -> bool:
    """Does the whole part lie behind the plane of these faces, rugged by `rough_m`, and are they more than half of what lies in that plane?

    reach_m : round each of them that no point lies in: what is nearer in their plane was not seen either.
    """
    mean = (areas[own, None] * normals[own]).sum(axis=0) / areas[own].sum()
    length = float(np.linalg.norm(mean))
    if length < FLAT_END:
        return False
    way, middle = mean / length, mesh.vertices[mesh.faces].mean(axis=1)
    height = middle @ way
    level = float(height[own].mean())
    if float((mesh.vertices @ way).max()) > level + rough_m:
        return False
    beside = np.flatnonzero((np.abs(height - level) <= rough_m) & (normals @ way > FACES_SO))
    unseen = np.isin(beside, own) | (cKDTree(middle[own]).query(middle[beside])[0] < reach_m)
    return bool(areas[beside[unseen]].sum() > WHOLE_END * areas[beside].sum())
