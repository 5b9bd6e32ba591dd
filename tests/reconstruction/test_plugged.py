from dataclasses import replace

import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.reconstruction import reconstruct, visibility
from scan2fea.reconstruction.budget import UNSEEN_WALLS
from scan2fea.reconstruction.empty_places import EMPTY_PLACES
from scan2fea.reconstruction.evidence import at_most
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_planar import BESIDE_FLATS
from scan2fea.reconstruction.plugged import BOTTOM, PLUGGED, unplugged
from scan2fea.simulation.shapes import chs, cylinder
from scan2fea.types import PointCloud, Scan, TriangleMesh
from scanned import scanned

OUTER, BORE, LENGTH, H = 0.06, 0.015, 0.2, 0.004  # the middle of the bore is nearer to the round side than to an end
POSE, PLACE = rotation(3), np.array([1.0, -0.4, 0.2])
TUBE = moved(chs(2 * OUTER, OUTER - BORE, LENGTH), POSE, PLACE)
BAR = moved(cylinder(OUTER, LENGTH), POSE, PLACE)


@pytest.fixture(scope="module")
def seen():
    """The tube, scanned from places that are known; its first surface; and the bar that planes would make of it, refused for its empty places."""
    scan, _, _ = scanned(TUBE, H)
    first = visibility(scan)
    assert not failed(first.checks)
    corners = BAR.vertices[BAR.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    region = np.unique(np.round(normal, 6), axis=0, return_inverse=True)[1].ravel()
    bar = TriangleMesh(vertices=BAR.vertices, faces=BAR.faces, face_region=region.astype(np.int64))
    return scan, first, replace(first, mesh=bar, checks=(at_most(EMPTY_PLACES, 1.0, 0.0, "empty"),))


def check_of(found):
    return {check.name: check for check in found.checks}[PLUGGED]


def test_an_open_bore_passes_and_a_closed_one_is_told(seen):
    scan, first, bar = seen
    assert check_of(unplugged(scan, first, (bar,))).passed
    closed = unplugged(scan, replace(first, mesh=BAR), (bar,))
    names = [check.name for check in closed.checks]
    assert len(names) == len(set(names))  # a row each in the report
    told = check_of(closed)
    assert not told.passed and told.value == 1.0 and "scan into it" in told.says
    blind = Scan(cloud=PointCloud.of(scan.cloud.points))
    assert check_of(unplugged(blind, replace(first, source="outside flood"), (bar,))).passed
    assert not check_of(unplugged(blind, replace(first, source="outside flood", mesh=BAR), (bar,))).passed


@pytest.mark.parametrize(("left_out", "passed"), [(0.4, False), (0.6, True)])
def test_a_flat_solid_that_leaves_out_most_points_tells_nothing(seen, left_out, passed):
    scan, first, bar = seen
    other = replace(bar, checks=(*bar.checks, at_most(BESIDE_FLATS, left_out, 0.01, "curved")))
    found = unplugged(scan, replace(first, mesh=BAR), (other,))
    assert (PLUGGED not in {check.name for check in found.checks}) is passed


@pytest.mark.parametrize(("count", "aside", "passed"), [(BOTTOM, 0.3, True), (BOTTOM - 1, 0.3, False), (50, 0.95, False)])
def test_a_bottom_that_was_measured_closes_a_bore(seen, count, aside, passed):
    scan, first, bar = seen
    bottom = POSE @ [aside * BORE, 0.0, 0.5 * LENGTH] + PLACE
    cloud = PointCloud.of(np.concatenate([scan.cloud.points, np.tile(bottom, (count, 1))]))
    told = check_of(unplugged(Scan(cloud=cloud), replace(first, source="outside flood", mesh=BAR), (bar,)))
    assert told.passed is passed


def test_planes_refused_for_walls_that_no_line_passed_are_asked_as_well(seen):
    """A long tube from a few stations: lines enter both mouths, none passes the middle; the free form closed both, and the tube was a bar."""
    scan, first, bar = seen
    unseen = replace(bar, checks=(at_most(UNSEEN_WALLS, 0.6, 0.05, "nobody saw"),))
    assert not check_of(unplugged(scan, replace(first, mesh=BAR), (unseen,))).passed
    assert check_of(unplugged(scan, first, (unseen,))).passed


def test_nothing_is_said_of_what_is_refused_already_nor_without_empty_places(seen):
    scan, first, bar = seen
    assert unplugged(scan, first, ()) is first
    assert unplugged(scan, first, (replace(bar, checks=first.checks),)) is first
    bad = replace(first, checks=bar.checks)
    assert unplugged(scan, bad, (bar,)) is bad


def test_places_that_no_sight_line_enters_are_not_asked(seen):
    scan, first, bar = seen
    blind = Scan(cloud=PointCloud.of(scan.cloud.points))  # no line at all
    assert check_of(unplugged(blind, replace(first, mesh=BAR), (bar,))).passed


def test_a_whole_tube_is_passed(seen):
    assert not failed(reconstruct(seen[0]).checks)
