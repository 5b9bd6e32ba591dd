"""Round ends of slots through walls, from points half a wall apart; a flat end is none, and a slot is one opening."""

from dataclasses import replace

import numpy as np
import pytest

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.surfaces import CYLINDER, Surface
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.bores import Bore
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.lost_bores import closed_bores
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.reconstruction.slots import is_in_slot, slot_ends
from scan2fea.simulation.polyhedra import meshed, prism
from scanned import DENSITY, scanned

THICK, RADIUS, H = 0.012, 0.009, 0.0046
PLACES = np.array([0.05, 0.11])  # of the ends' middles, along the bar


def bar(n=24):
    """A flat bar with a slot whose ends have n sides each, 1: flat."""
    angle = np.pi * (np.arange(n + 1) / n - 0.5) if n > 1 else np.array([-0.5, 0.5]) * np.pi
    end = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    slot = np.concatenate([[PLACES[1], 0.04] + end, [PLACES[0], 0.04] - end])
    return meshed(prism([[0, 0], [0.16, 0], [0.16, 0.08], [0, 0.08]], THICK, [slot[::-1]]))


def told(mesh, sigma, seed):
    """The ends that `slot_ends` tells from points of a bar, the planes of faces and flats known."""
    places, face = sample_surface(mesh, int(DENSITY * 0.033 / H**2), seed)
    points = places + sigma * np.random.default_rng(seed).normal(size=places.shape)
    normal = np.array([[0, 0, 1], [0, 0, -1], [0, -1, 0], [0, 1, 0]], float)
    offset = np.array([THICK, 0.0, -0.04 - RADIUS, 0.04 - RADIUS])
    of = face_normals(mesh)[face]
    label = np.full(len(points), -1)
    for k in range(4):
        label[(of @ normal[k] > 0.999) & (np.abs(places @ normal[k] - offset[k]) < 1e-6)] = k
    return slot_ends(points, Planes(normal=normal, offset=offset, label=label, std_m=np.full(4, 1e-5)), H, sigma)


def test_both_ends_of_a_slot_are_told_and_no_flat_ones():
    slotted, square, n_ends = bar(), bar(1), 0
    for seed in range(8):
        for sigma in (0.0, 0.0003, 0.0006):
            ends = sorted(told(slotted, sigma, seed), key=lambda end: end.point[0])
            n_ends += len(ends)
            for end in ends:
                assert np.abs(end.point[0] - PLACES).min() < 0.0005 + 2 * sigma and end.point[1] == pytest.approx(0.04, abs=5e-4)
                assert 0.98 * RADIUS < end.radius < 1.03 * RADIUS and end.sense == -1
            assert not told(square, sigma, seed)
    assert n_ends > 0.8 * 48


def test_a_slot_is_two_flats_and_two_round_ends():
    """Its ends were one bore of 19.4 mm and none, and a slot that was open was refused for a bore too few."""
    mesh = bar()
    found = reconstruct(scanned(mesh, H, 0.0002, seed=2)[0])
    assert not failed(found.checks) and found.how["method"] == "planar"
    assert (found.how["n_planes"], found.how["n_cylinders"]) == (8, 2)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.003)


def test_the_ends_of_a_slot_are_one_opening_and_bores_beside_each_other_two():
    def bore(x, turns):
        turn = np.linspace(*turns, 24)
        wall = np.column_stack([x + RADIUS * np.cos(turn), 0.04 + RADIUS * np.sin(turn), THICK * (0.1 + 0.8 * (np.arange(24) % 5) / 4)])
        surface = Surface(kind=CYLINDER, point=np.array([x, 0.04, 0.0]), axis=np.array([0.0, 0.0, 1.0]), radius=RADIUS, sense=-1)
        return Bore(surface=surface, wall=wall, deep=np.ones(len(wall), bool), depth_m=THICK, around=8, beside=1.0)

    half = 0.5 * np.pi
    ends = [bore(PLACES[0], (half, 3 * half)), bore(PLACES[1], (-half, half))]
    assert closed_bores(ends, bar()).passed
    whole = [bore(x, (0.0, 4 * half)) for x in PLACES]
    assert closed_bores(whole, bar()).value == 2.0  # the wall between them was lost
    assert closed_bores(whole[:1], bar()).value == 1.0


def test_a_bore_between_the_ends_of_a_slot_is_none_of_its_own():
    ends = [Surface(kind=CYLINDER, point=np.array([x, 0.04, 0.003 * x]), axis=np.array([0.0, 0.0, 1.0]), radius=RADIUS, sense=-1) for x in PLACES]
    places = {0.045: True, 0.08: True, 0.117: True, 0.03: False, 0.13: False}
    for x, is_in in places.items():
        assert is_in_slot(replace(ends[0], point=np.array([x, 0.041, 0.007]), radius=0.9 * RADIUS), ends) == is_in
    assert not is_in_slot(replace(ends[0], axis=np.array([1.0, 0.0, 0.0])), ends) and not is_in_slot(ends[0], [])
