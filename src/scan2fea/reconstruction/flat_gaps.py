"""Volume that may hide behind gaps in the faces of a flat solid: such a face is far larger than the gaps in it, so each is looked at as a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.ndimage import binary_fill_holes, distance_transform_edt
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.rays import RayScene, first_hits, scene_of
from scan2fea.kernel.surfaces import Surface
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.empty_places import Discs
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.hidden_volume import REACH, hidden_check
from scan2fea.reconstruction.pictures import Flat, Picture, patches, pictures, regions
from scan2fea.reconstruction.plane_growing import FACING
from scan2fea.reconstruction.sight import Sight
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh

ENDS = 0.02  # of the volume: as `wall_ends`
MOST_CARRIED = 0.5  # of a face: a gap is carried over that is no larger than what was measured of it
BORDER = 1.75  # spacings from a measured point: random points leave 0.03 % of a face so bare
WHOLE_END = 0.5  # of an end that the whole part lies behind: with less of it measured the part may go on there (`wall_ends`)
SKIN = 0.05  # spacings under a face from which the other face of its wall is looked for: facets lie that far off the cylinder they stand for
NONE_ROLLED: Mapping[int, Surface] = MappingProxyType({})
BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1))


def hidden_volume_flat(
    mesh: TriangleMesh, points: FloatArray, spacing_m: float, rolled: Mapping[int, Surface] = NONE_ROLLED, walls: Discs | None = None
) -> Check:
    """As `hidden_volume`, of a solid of flat faces (`face_region` is set), each triangle of which is larger than the gaps in it.

    A gap is what lies farther than REACH spacings from the points of its face.
    points : (n, 3) measured, or inferred from a support that was seen.
    walls : that may be holes, counted as such already (`empty_places`): what hides over them can only be more than the solid has, so of the two the
    larger counts.
    """
    tree, hidden, over, where = cKDTree(points), 0.0, 0.0, [np.zeros((0, 3))]
    for picture in pictures(mesh, points, spacing_m, REACH * spacing_m, rolled).values():
        far = picture.far(REACH * spacing_m)
        for at in patches(far):
            size, sides = len(at) * picture.pixel**2, picture.pixel * _sides(picture, far, at, tree, REACH * spacing_m)[0]
            hidden += (own := size**2 / max(sides, math.sqrt(size)))
            where.append(picture.places(at))
            over += 0.0 if walls is None else own * float(walls.bare_at(where[-1], picture.pixel).mean())
    hidden -= 0.0 if walls is None else min(over, walls.volume_m3)
    return hidden_check(hidden / abs(volume(mesh)), np.concatenate(where))


def flat_ends(
    mesh: TriangleMesh, points: FloatArray, spacing_m: float, rolled: Mapping[int, Surface] = NONE_ROLLED, walls: Discs | None = None
) -> Check:
    """How much may hide beyond places of flat faces (`face_region` is set) that lie far from all points, of whatever face?

    Where a wall ends, the points of its end or of either of its faces go up to the edge. A place that has none, of area A and L across, hides
    A L / pi, as a face without points does (`bare_faces`). Where the face was seen all round it no wall ends there: at most what is under it is
    missing, and of a place whose other side was not seen either each side counts half. What may lie on it is asked of `hidden_volume_flat`.
    walls : that may be holes, counted as such already (`empty_places`).
    """
    tree, scene, hidden, where = cKDTree(points), scene_of(mesh), 0.0, [np.zeros((0, 3))]
    for picture in pictures(mesh, points, spacing_m, REACH * spacing_m, rolled).values():
        far = picture.far(REACH * spacing_m)
        at = np.argwhere(far)
        near = np.asarray(tree.query(picture.places(at))[0]) <= REACH * spacing_m
        far[tuple(at[near].T)] = False
        for own in patches(far):
            across = picture.pixel * float(np.linalg.norm(np.ptp(own, axis=0) + 1))
            deep, places = np.full(len(own), across / math.pi), picture.places(own)
            if all(_inside(picture, own + step).all() for step in BESIDE):
                deep = np.minimum(deep, _under(scene, places, -picture.normals(own), tree, spacing_m))
                if walls is not None:
                    deep[walls.bare_at(places, picture.pixel)] = 0.0
            hidden += float(deep.sum()) * picture.pixel**2
            where.append(places)
    share = min(1.0, hidden / abs(volume(mesh)))
    says = (
        f"{share:.1%} of the volume may hide beyond ends of walls where no point was measured (limit {ENDS:.0%}){around(np.concatenate(where))}: "
        "the scan may end there, not the wall; scan the edges too, or fit the member"
    )
    return at_most(WALL_ENDS, share, ENDS, says)


def _under(scene: RayScene, places: FloatArray, way: FloatArray, tree: cKDTree, spacing_m: float) -> FloatArray:
    """(k,) how far it is to the other side of the solid under places (k, 3), half of it where no point is near there either; inf: no other side, m.

    way : (k, 3) inward.   tree : of all points.
    """
    skin = SKIN * spacing_m
    deep, hit = first_hits(scene, places + skin * way, way)
    deep = np.where(hit >= 0, skin + deep, math.inf)
    met = np.flatnonzero(hit >= 0)
    unseen = np.asarray(tree.query(places[met] + deep[met, None] * way[met])[0]) > REACH * spacing_m
    deep[met[unseen]] *= 0.5
    return deep


def half_seen_ends(
    mesh: TriangleMesh, points: FloatArray, sight: Sight, spacing_m: float, rolled: Mapping[int, Surface] = NONE_ROLLED
) -> Check:
    """Of how many flat faces that the whole part lies behind was less than half seen?

    Of what lies within such an end (its convex hull) the face was seen near its own points, an opening beside or in it near where sight lines pass
    it: nothing else shows that the part ends there. A hole in such an end is asked for too where most of the face was seen: a cup without its bottom,
    half of the rim left, was a tube. How far the face itself may go on where it has no points is asked of `flat_ends`.

    points : (n, 3) measured or carried.
    """
    normals, region, where = face_normals(mesh), regions(mesh), [np.zeros((0, 3))]
    for number, picture in pictures(mesh, points, spacing_m, REACH * spacing_m, rolled).items():
        own = region == number
        corners = mesh.vertices[mesh.faces[own]].reshape(-1, 3)
        plane = Plane(normal=normals[own][0], offset=float(corners[0] @ normals[own][0]))
        is_end = isinstance(picture.sheet, Flat) and float(plane.distance(mesh.vertices).max()) <= SKIN * spacing_m
        measured = picture.inside & ~picture.far(REACH * spacing_m)
        if not is_end:
            continue
        openings, enclosed = picture.hull(corners) & ~picture.inside, binary_fill_holes(picture.inside) & ~picture.inside
        crossed = picture.away_from(sight.crossings(plane, spacing_m)) <= REACH * spacing_m
        few = measured.sum() < WHOLE_END * picture.inside.sum()
        for asked, is_open in ((few, openings), (enclosed.any(), enclosed)):
            if asked and measured.sum() + (is_open & crossed).sum() < WHOLE_END * (picture.inside.sum() + is_open.sum()):
                where.append(corners)
                break
    says = (
        f"{len(where) - 1} flat ends of the part were seen by less than half{around(np.concatenate(where))}: "
        "the scan may end there, not the part; scan them too, or fit the member"
    )
    return at_most("ends of the part seen in part", float(len(where) - 1), 0.0, says)


def _sides(picture: Picture, far: BoolArray, at: IntArray, tree: cKDTree, reach_m: float) -> tuple[int, int]:
    """Sides of pixels `at` where a gap ends, and where it goes on round the edge.

    Where it meets the outline of the face it ends if points of other faces are near (tree : of all points).
    """
    ends, goes_on, places = 0, 0, picture.places(at)
    for step in BESIDE:
        i, j = (at + step).T
        on = _inside(picture, at + step)
        ends += int(np.sum(~far[i[on], j[on]]))
        near = np.asarray(tree.query(places[~on])[0]) <= reach_m
        ends, goes_on = ends + int(near.sum()), goes_on + int(np.sum(~near))
    return ends, goes_on


def _width(at: IntArray) -> float:
    """Radius of the largest circle in pixels (k, 2), in pixels."""
    held = np.zeros(at.max(axis=0, initial=0) + 3, bool)
    held[tuple((at + 1).T)] = True
    return float(distance_transform_edt(held).max())


def _inside(picture: Picture, at: IntArray) -> BoolArray:
    """(k,) are pixels (k, 2) of the face?"""
    on: BoolArray = np.asarray(((at >= 0) & (at < picture.inside.shape)).all(axis=1))
    on[on] = picture.inside[tuple(at[on].T)]
    return on


def over_walls(mesh: TriangleMesh, points: FloatArray, spacing_m: float, rolled: Mapping[int, Surface] = NONE_ROLLED) -> FloatArray:
    """(k, 3) places on gaps of flat faces behind which the other face of a wall was measured, where most of the face itself was.

    points : (n, 3) measured. What `opposite` does for any surface: a wall goes on as thick as it was measured round about. So it does in a larger
    gap that is no wider than what was measured of the face, that ends at measured points all round, and behind which the wall has the other face
    that it has where it was measured (one face of a stiffener, of which the rims were seen, and both faces of its fellow across the web).
    """
    region, scene, normals = regions(mesh), scene_of(mesh), face_normals(mesh)
    near, skin = PointToMesh(mesh).nearest(points), SKIN * spacing_m
    of, tree, out = region[near.face], cKDTree(points), [np.zeros((0, 3))]

    def behind(picture: Picture, at: IntArray) -> tuple[FloatArray, IntArray]:
        way = -picture.normals(at)
        depth, hit = first_hits(scene, picture.places(at) + skin * way, way)
        is_wall = (hit >= 0) & (np.einsum("ij,ij->i", normals[hit], way) > -FACING)
        return picture.places(at) + (skin + depth)[:, None] * way, np.where(is_wall, region[hit], -1)

    for picture in pictures(mesh, points, spacing_m, REACH * spacing_m, rolled).values():
        far = picture.far(BORDER * spacing_m)
        gaps = [at for at in patches(far) if picture.away[tuple(at.T)].max() > REACH * spacing_m]
        is_most = sum(map(len, gaps)) > MOST_CARRIED * picture.inside.sum()
        if is_most:
            most = _width(np.argwhere(picture.inside & ~far))
            gaps = [at for at in gaps if _width(at) <= most and not _sides(picture, far, at, tree, REACH * spacing_m)[1]]
        if not gaps:
            continue
        places = picture.places(np.concatenate(gaps))
        foot, other_of = behind(picture, np.concatenate(gaps))
        is_wall = other_of >= 0
        if is_most:
            is_wall &= np.isin(other_of, behind(picture, np.argwhere(picture.inside & ~far))[1])
        for other in np.unique(other_of[is_wall]):
            rows = np.flatnonzero(is_wall & (other_of == other))
            seen = near.closest[of == other]
            is_wall[rows] = np.asarray(cKDTree(seen).query(foot[rows])[0]) <= BORDER * spacing_m if len(seen) else False
        out.append(places[is_wall])
    return np.concatenate(out)
