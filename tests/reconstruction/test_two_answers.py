from dataclasses import replace

import numpy as np

from predicates import moved, rotation
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction import reconstruct, visibility
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.planar import served
from scan2fea.reconstruction.two_answers import DIFFER, FLAT_INSTEAD, contradicted
from scan2fea.simulation.polyhedra import meshed, prism
from scanned import scan_of, scanned

T, H = 0.15, 0.04
ANGLE = moved(meshed(prism([[0, 0], [0.8, 0], [0.8, T], [T, T], [T, 0.8], [0, 0.8]], 1.0)), rotation(109), np.array([2.0, 0.0, -1.0]))


def without_a_corner(share, seed=1):
    """The angle without the points nearest to an end of one leg, whichever face they lie on."""
    scan, places, _ = scanned(ANGLE, H, seed=seed)
    middle = np.array([2.0, 0.0, -1.0]) + rotation(109) @ [0.8, 0.0, 1.0]
    off = np.linalg.norm(places - middle, axis=1)
    keep = off > np.quantile(off, share)
    return scan_of(scan.cloud.points[keep], scan.sensors()[keep])


def test_a_corner_that_was_not_scanned_is_told_by_the_planes_that_carry_it_on():
    scan = without_a_corner(0.09)
    first = visibility(scan)
    assert not failed(first.checks) and volume(first.mesh) < 0.95 * volume(ANGLE)  # nothing is said against it
    refused = contradicted(scan, served(scan, first))
    check = {check.name: check for check in refused.checks}[FLAT_INSTEAD]
    assert not check.passed and 0.03 < check.value < 0.09
    assert "may not have been scanned" in check.says
    assert FLAT_INSTEAD in [check.name for check in failed(reconstruct(scan).checks)]


def test_nothing_is_said_of_what_was_seen_or_is_refused_already():
    whole = without_a_corner(0.0)
    first = visibility(whole)
    assert contradicted(whole, first) is first
    differs = replace(first, how={**first.how, "not_planar": DIFFER})
    assert contradicted(whole, differs) is differs  # asked again, planes and surface agree
    cut = without_a_corner(0.09)
    first = served(cut, visibility(cut))
    blind = replace(first, source="outside flood")
    assert contradicted(cut, blind) is blind
    bad = replace(first, checks=(replace(first.checks[0], passed=False), *first.checks[1:]))
    assert contradicted(cut, bad) is bad


def test_a_corner_that_lines_of_sight_pass_through_is_off():
    cut = without_a_corner(0.09)
    first = served(cut, visibility(cut))
    corner = np.array([2.0, 0.0, -1.0]) + rotation(109) @ np.array([0.7, 0.05, 0.9])
    end = cut.cloud.points[::20]  # these were seen from beyond the corner: their lines run through it
    seen = cut.sensors().copy()
    seen[::20] = corner + (corner - end)
    assert contradicted(scan_of(cut.cloud.points, seen), first) is first
