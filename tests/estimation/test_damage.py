"""Damage: found where it is, with its depth; nothing on sound members; nothing that clutter or a biased section could fake."""

import numpy as np
import pytest

from estimation.made import SIZES, made, scanned
from predicates import rotation
from scan2fea.errors import UsageError
from scan2fea.estimation.damage import LEVEL, damages
from scan2fea.estimation.field import residual_field
from scan2fea.estimation.solid import solid_of
from scan2fea.kernel.distances import signed_distance

L = {"a": 0.127, "b": 0.127, "t": 0.00635}


def loss(depth, low, high):
    """Corrosion of the outer face of leg a between two heights."""

    def change(local):
        local = local.copy()
        rows = (local[:, 1] < 1e-9) & (local[:, 2] > low) & (local[:, 2] < high)
        local[rows, 1] += depth
        return local

    return change


def dent(depth, x, z, width):
    """Leg a pushed in, both faces alike."""

    def change(local):
        local = local.copy()
        rows = (local[:, 1] < 0.0064) & (local[:, 0] > 0.0064)
        local[rows, 1] += depth * np.exp(-(((local[rows, 0] - x) / width) ** 2 + ((local[rows, 2] - z) / width) ** 2))
        return local

    return change


@pytest.mark.parametrize("family", ["L", "CHS", "rect", "RHS"])
def test_field_is_the_signed_distance(family):
    member = made(family, 1.0, R=rotation(4), shift=(1, 2, 3))
    solid = solid_of(member)
    points = scanned(member, 500, 0.003, 1)
    local = (points - [1, 2, 3]) @ member.T_world_member[:3, :3]
    middle = (local[:, 2] > 0.05) & (local[:, 2] < 0.95)  # nearer to a side than to an end
    field = residual_field(points, solid)
    assert field.off_m[middle] == pytest.approx(signed_distance(points, solid.mesh)[middle], abs=1e-9)
    assert field.z_m == pytest.approx(local[:, 2])


def test_no_damage_on_sound_members():
    """48 scans of all families, noise from a tenth of a wall to two walls, with and without clutter: at the stated level one may show something."""
    found = 0
    for k, family in enumerate(SIZES):
        for seed, sigma in enumerate((0.0005, 0.002, 0.0067)):
            for clutter in (0.0, 0.15):
                member = made(family, 3.0, R=rotation(k), sigma=sigma)
                found += bool(damages(scanned(member, 8000, sigma, seed + 10 * k, clutter), member, sigma))
    assert found <= 48 * LEVEL + 3 * np.sqrt(48 * LEVEL)


def test_a_biased_section_is_no_damage():
    """A wall fitted 0.4 mm too thick moves whole faces: no place differs from the rest of its strip."""
    true = made("L", 3.0, L)
    wrong = made("L", 3.0, {**L, "t": 0.00675})
    assert damages(scanned(true, 10_000, 0.0005, 3), wrong, 0.0005) == ()


def test_corrosion_has_its_place_depth_and_kind():
    R, shift = rotation(5), np.array([5.0, -3.0, 1.0])
    member = made("L", 3.0, L, R=R, shift=shift)
    first = damages(scanned(member, 20_000, 0.0005, 2, change=loss(0.001, 1.0, 1.4)), member, 0.0005)[0]
    at = (first.position_m - shift) @ R
    assert first.kind == "loss" and first.p_value < 1e-6
    assert abs(first.depth_m - 0.001) < 4 * first.std_m and first.std_m < 2e-4
    assert 1.0 < at[2] < 1.4 and abs(at[1]) < 1e-9 and 0 < at[0] < 0.127


def test_a_dent_moves_both_faces_of_the_wall():
    member = made("L", 3.0, L)
    found = damages(scanned(member, 20_000, 0.0005, 2, change=dent(0.003, 0.07, 1.0, 0.06)), member, 0.0005)
    assert found[0].kind == "dent"
    assert 0.001 < found[0].depth_m < 0.0035
    assert np.linalg.norm(found[0].position_m - [0.07, 0.003, 1.0]) < 0.08
    assert all(abs(place.position_m[2] - 1.0) < 0.25 for place in found)


def test_what_sticks_out_is_a_bulge():
    member = made("rect", 2.0, {"b": 0.2, "t": 0.05})

    def patch(local):
        local = local.copy()
        rows = (local[:, 1] > 0.0249) & (abs(local[:, 2] - 0.8) < 0.15) & (abs(local[:, 0]) < 0.06)
        local[rows, 1] += 0.002
        return local

    found = damages(scanned(member, 15_000, 0.0005, 1, change=patch), member, 0.0005)
    assert found[0].kind == "bulge" and found[0].depth_m < 0
    assert abs(found[0].position_m[2] - 0.8) < 0.15


def test_a_notch_deep_in_a_bar_is_seen():
    member = made("rect", 1.0, {"b": 0.2, "t": 0.2})

    def notch(local):
        local = local.copy()
        rows = (local[:, 1] > 0.0999) & (abs(local[:, 2] - 0.5) < 0.06) & (abs(local[:, 0]) < 0.06)
        local[rows, 1] -= 0.05
        return local

    found = damages(scanned(member, 20_000, 0.001, 1, change=notch), member, 0.001)
    assert any(abs(place.depth_m - 0.05) < 0.01 and np.linalg.norm(place.position_m - [0, 0.1, 0.5]) < 0.1 for place in found)


def test_frame_and_order_do_not_matter():
    plain, R = made("L", 3.0, L), rotation(7)
    turned = made("L", 3.0, L, R=R, shift=(10, 20, 30))
    points = scanned(plain, 10_000, 0.0005, 2, change=loss(0.002, 1.0, 1.3))
    one, other = damages(points, plain, 0.0005), damages(points[::-1] @ R.T + [10, 20, 30], turned, 0.0005)
    assert len(one) == len(other) > 0
    assert other[0].position_m == pytest.approx(R @ one[0].position_m + [10, 20, 30], abs=1e-6)
    assert other[0].depth_m == pytest.approx(one[0].depth_m, rel=1e-6)


def test_few_points_say_nothing_and_bad_noise_is_refused():
    member = made("L", 3.0, L)
    assert damages(scanned(member, 60, 0.001, 1), member, 0.001) == ()
    with pytest.raises(UsageError, match="noise is nan"):
        damages(np.zeros((100, 3)), member, float("nan"))
