import sys
from dataclasses import replace

import numpy as np
import pytest

from predicates import box, moved, rotation
from scan2fea.kernel.distances import sample_surface, signed_distance
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction import reconstruct, visibility
from scan2fea.reconstruction.bare_ends import BARE_ENDS
from scan2fea.reconstruction.budget import FLAT_INSTEAD, VOLUME_IN_DOUBT, WALL_ENDS
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_outside import CUT_HELD, cut_agrees
from scan2fea.reconstruction.gates_planar import DIFFER
from scan2fea.reconstruction.gates_surface import UNDER_FACES
from scan2fea.reconstruction.inner_places import PLACES, inner_places, told_by_left_out
from scan2fea.reconstruction.planar import flattened, served
from scan2fea.reconstruction.two_answers import CUT, apart, contradicted
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.types import Check, PointCloud, Scan
from scanned import scan_of, scanned

T, H = 0.15, 0.04
ENDS = {BARE_ENDS, WALL_ENDS}
ANGLE = moved(meshed(prism([[0, 0], [0.8, 0], [0.8, T], [T, T], [T, 0.8], [0, 0.8]], 1.0)), rotation(109), np.array([2.0, 0.0, -1.0]))


def without_a_corner(share, seed=1):
    """The angle without the points nearest to an end of one leg, whichever face they lie on."""
    scan, places, _ = scanned(ANGLE, H, seed=seed)
    middle = np.array([2.0, 0.0, -1.0]) + rotation(109) @ [0.8, 0.0, 1.0]
    off = np.linalg.norm(places - middle, axis=1)
    keep = off > np.quantile(off, share)
    return scan_of(scan.cloud.points[keep], scan.sensors()[keep])


def but_for_its_end(first):
    """As if nobody had asked for the end of the part: the planes are to tell of the corner by themselves."""
    return replace(first, checks=tuple(check for check in first.checks if check.name not in ENDS))


def test_a_corner_that_was_not_scanned_is_told_by_the_planes_that_carry_it_on():
    scan = without_a_corner(0.09)
    asked = visibility(scan)
    names = {check.name for check in failed(asked.checks)}
    assert names and names <= ENDS  # the cut is flat and the whole part lies behind it, or it bites into the walls: rounding decides
    first = but_for_its_end(asked)
    assert volume(first.mesh) < 0.95 * volume(ANGLE)
    same, flats = served(scan, first)
    assert same.mesh is first.mesh and flats
    refused = contradicted(scan, same, flats)
    check = {check.name: check for check in refused.checks}[FLAT_INSTEAD]
    assert not check.passed and 0.02 < check.value < 0.09
    assert "may not have been scanned" in check.says
    assert failed(reconstruct(scan).checks)


def test_without_sensors_the_planes_that_hold_all_points_tell_it_too():
    """Points on the wall of a hole that was scanned would lie beside their faces."""
    cut = without_a_corner(0.09)
    first, flats = served(cut, but_for_its_end(visibility(cut)))
    told = contradicted(Scan(cloud=PointCloud.of(cut.cloud.points)), replace(first, source="outside flood"), flats)
    check = {check.name: check for check in told.checks}[FLAT_INSTEAD]
    assert not check.passed and 0.02 < check.value < 0.09


def test_points_under_the_faces_of_a_flat_solid_speak_against_the_free_form_that_is_the_same_solid():
    scan, _, _ = scanned(ANGLE, H, seed=1)
    first = replace(visibility(scan), source="outside flood")
    hollow = replace(first, checks=(*first.checks, Check(name=UNDER_FACES, value=9.0, limit=8.0, unit="1", passed=False)))
    assert [check.name for check in failed(contradicted(scan, first, [hollow]).checks)] == [UNDER_FACES]
    larger = replace(hollow, mesh=replace(first.mesh, vertices=1.01 * first.mesh.vertices))
    assert not failed(contradicted(scan, first, [larger]).checks), "another solid"


def test_nothing_is_said_of_what_is_refused_already_nor_of_images():
    cut = without_a_corner(0.09)
    first, flats = served(cut, but_for_its_end(visibility(cut)))
    assert contradicted(cut, first, ()) is first
    images = replace(first, source="ranges")
    assert contradicted(cut, images, flats) is images
    bad = replace(first, checks=(replace(first.checks[0], passed=False), *first.checks[1:]))
    assert contradicted(cut, bad, flats) is bad
    flat = replace(first, how={**first.how, "method": "planar"})
    assert contradicted(cut, flat, flats) is flat
    elsewhere = replace(flats[0], checks=(*flats[0].checks, replace(flats[0].checks[0], name="stray points", passed=False)))
    assert contradicted(cut, first, (elsewhere,)) is first  # a flat solid that does not hold the points says nothing


def test_a_corner_that_lines_of_sight_pass_through_is_off():
    cut = without_a_corner(0.09)
    first, flats = served(cut, but_for_its_end(visibility(cut)))
    corner = np.array([2.0, 0.0, -1.0]) + rotation(109) @ np.array([0.7, 0.05, 0.9])
    end = cut.cloud.points[::20]  # these were seen from beyond the corner: their lines run through it
    seen = cut.sensors().copy()
    seen[::20] = corner + (corner - end)
    assert contradicted(scan_of(cut.cloud.points, seen), first, flats) is first


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_what_one_of_two_solids_holds_more_is_counted_beyond_what_spacing_and_noise_explain(size):
    """A cube, and the same without a slab of it: the slab counts but for the depth that edges cut and noise moves."""
    cube = moved(box((1.0, 1.0, 1.0)), size * rotation(3), np.zeros(3))
    scan, _, _ = scanned(cube, 0.06 * size, seed=0)
    first = replace(visibility(scan), sigma_m=0.01 * size)
    for slab in (0.0, 0.05, 0.2):
        less = moved(box((1.0, 1.0, 1.0 - slab)), size * rotation(3), np.zeros(3))
        check = apart(scan, replace(first, mesh=less), cube)
        due = max(0.0, slab - CUT * first.spacing_m / size - 0.01)
        assert abs(check.value - due) < 4 * np.sqrt(due / PLACES) + 1e-12
        assert check.passed == (check.value <= 0.02)
        other = apart(scan, replace(first, mesh=cube), less)  # where the free form holds more, the share is of the flat solid
        assert abs(other.value - due / (1.0 - slab)) < 4 * np.sqrt(due / PLACES) / (1.0 - slab) + 1e-12


@pytest.mark.parametrize(("asked", "due"), [(1.0, 0.2), (0.8, 0.0)])
def test_volume_that_a_surface_lacks_about_points_that_it_left_out_is_theirs_to_tell(asked, due):
    """A cube, and the same without a slab of it whose points are there; below the slab none is left out."""
    cube, less = box((1.0, 1.0, 1.0)), box((1.0, 1.0, 0.8))
    points = sample_surface(cube, 40_000, 0)[0]
    points = points[points[:, 2] <= asked]
    off = np.maximum(points[:, 2] - 0.8, 0.0)
    told = told_by_left_out(points, cube, less, off, 1e-9)
    assert abs(told - due) < 4 * np.sqrt(due / PLACES) + 1e-12


@pytest.mark.parametrize("source", ["outside flood", "sensors"])
def test_a_first_surface_that_left_points_out_is_no_witness_of_what_lies_about_them(source):
    """An end of the angle is off the first surface, and its points are there; sight lines tell of it themselves."""
    scan = Scan(cloud=scanned(ANGLE, H, seed=1)[0].cloud)
    first = visibility(scan)
    short = moved(meshed(prism([[0, 0], [0.8, 0], [0.8, T], [T, T], [T, 0.8], [0, 0.8]], 0.9)), rotation(109), np.array([2.0, 0.0, -1.0]))
    flat = flattened(scan, replace(first, mesh=short, source=source))
    assert volume(flat.mesh) == pytest.approx(volume(ANGLE), rel=0.01)
    assert (DIFFER in {check.name for check in failed(flat.checks)}) == (source == "sensors")


def test_places_are_uniform_in_the_solid_however_it_lies():
    beam = moved(ANGLE, rotation(5), np.array([10.0, 0.0, 0.0]))
    places = inner_places(beam)
    assert len(places) == PLACES and (signed_distance(places, beam) < 0).all()
    assert np.array_equal(places, inner_places(beam)) and not np.array_equal(places, inner_places(beam, 1))
    local = (((places - [10.0, 0.0, 0.0]) @ rotation(5)) - [2.0, 0.0, -1.0]) @ rotation(109)
    leg = T * 0.8 / (T * 0.8 + T * (0.8 - T))
    assert abs(np.mean(local[:, 1] < T) - leg) < 4 * np.sqrt(leg * (1 - leg) / PLACES)
    assert abs(local[:, 2].mean() - 0.5) < 4 * np.sqrt(1 / 12 / PLACES)


@pytest.mark.parametrize(("against", "source", "asked"), [
    ((DIFFER,), "sensors", [False, True]), ((DIFFER, "stray points"), "sensors", [False, True]), ((DIFFER, "bent faces"), "sensors", [False]),
    (("stray points",), "sensors", [False]), ((DIFFER,), "outside flood", [False]),
])  # fmt: skip
def test_sight_lines_say_which_is_right_where_flat_solid_and_free_form_differ_alone(monkeypatch, against, source, asked):
    scan = scanned(ANGLE, H, seed=1)[0]
    first, flat, ways = visibility(scan), flattened(scan, visibility(scan)), []

    def answer(_scan, _first, _seed, by_lines, _faces):
        ways.append(by_lines)
        checks = tuple(replace(check, passed=by_lines or check.name not in against) for check in flat.checks)
        return replace(flat, checks=checks)

    assert not failed(first.checks)
    monkeypatch.setattr(sys.modules["scan2fea.reconstruction.planar"], "flattened", answer)
    found, refused = served(scan, replace(first, source=source))
    assert ways == asked and len(refused) == 1
    names = [check.name for check in found.checks]
    assert (found.mesh is flat.mesh) == (True in asked) == (FLAT_INSTEAD in names)
    assert names.count(VOLUME_IN_DOUBT) == 1


def test_what_the_cut_of_the_first_surface_lost_is_asked_of_the_flat_solid():
    """Its normals, which the points told without any surface, say what lies under each of them; a tenth turned about say no."""
    scan = Scan(cloud=scanned(ANGLE, H, seed=1)[0].cloud)
    first = visibility(scan)
    lost = replace(first, checks=(*first.checks, cut_agrees(0.8)))
    assert not failed(flattened(scan, lost).checks)
    turned = np.where(np.arange(len(first.normals)) % 10 == 0, -1.0, 1.0)[:, None] * first.normals
    assert [check.name for check in failed(flattened(scan, replace(lost, normals=turned)).checks)] == [CUT_HELD]
    assert CUT_HELD in {check.name for check in failed(flattened(scan, replace(lost, source="sensors")).checks)}
