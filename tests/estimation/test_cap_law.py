from functools import partial

import numpy as np
import pytest

from scan2fea.estimation.cap_law import Across, across, cap_ratios, share_like_caps, together, told_across
from scan2fea.estimation.ends import find_ends, rough_ends
from scan2fea.kernel.section_likelihood import face_lengths
from scan2fea.kernel.sections import PARAMETERS, section, section_area
from scan2fea.simulation.member import MemberScanOptions, member_points

L = {"a": 0.15, "b": 0.1, "t": 0.012, "length": 1.8}
SECTIONS = {"C": (0.16, 0.065, 0.0075, 0.0105), "RHS": (0.15, 0.1, 0.008), "CHS": (0.1683, 0.01), "round": (0.06,)}


def look_at(family, values, sigma):
    values = np.array(values)
    return partial(across, family, values, sigma, "gaussian", np.ones(len(face_lengths(family, values))), 1.0)


@pytest.mark.parametrize("family", SECTIONS)
def test_a_cap_s_points_fill_the_section_as_drawn_ones_do(family):
    values, sigma = SECTIONS[family], 0.004
    shape = dict(zip(PARAMETERS[family], values, strict=True))
    step = 0.001
    grid = np.arange(-0.12, 0.12, step) + step / 2
    xy = np.stack(np.meshgrid(grid, grid, indexing="ij"), -1).reshape(-1, 2)
    density = look_at(family, values, sigma)(xy).cap
    assert density.sum() * step**2 == pytest.approx(1.0, abs=2e-3)  # a circle is a polygon here
    # moments of the blurred section against those of points that were drawn
    drawn = member_points(family, {**shape, "length": 1e-9}, 40_000, MemberScanOptions(noise_m=sigma, caps=True, seed=1))
    assert np.sqrt(density @ (xy**2) * step**2) == pytest.approx(np.sqrt((drawn[:, :2] ** 2).mean(0)), rel=0.02)


def test_one_end_speaks_for_the_other_and_none_speaks_without_evidence():
    n, one = len(cap_ratios(1.0)), np.ones(1)
    nothing = np.zeros((1, n))
    silent = together(nothing, nothing, one)[0, :, 0]
    assert silent.sum() == pytest.approx(1) and silent == pytest.approx(silent.T)
    assert silent.sum(0)[:2] == pytest.approx([0.45, 0.45])
    seen = np.full((1, n), -np.inf)
    seen[0, 1] = 0.0
    told = together(seen, nothing, one)[0, :, 0]
    assert told[1].sum() == pytest.approx(1)
    assert told.sum(0)[1] == pytest.approx(2 / 3 + 0.45 / 3) and told.sum(0)[0] == pytest.approx(0.45 / 3)


def test_noise_along_the_axis_is_mostly_one_for_both_ends():
    n, prior = len(cap_ratios(1.0)), np.array([1.0, 3.0])
    nothing = np.zeros((2, n))
    silent = together(nothing, nothing, prior).sum(axis=(1, 3))
    assert silent.sum(0) == pytest.approx([0.25, 0.75]) and silent.sum(1) == pytest.approx([0.25, 0.75])
    seen = np.stack([nothing[0], np.full(n, -np.inf)])
    told = together(seen, nothing, prior).sum(axis=(1, 3))
    assert told[0] == pytest.approx([2 / 3 + 0.25 / 3, 0.75 / 3]) and not told[1].any()
    both = together(np.array([[1.0] * n, [0.0] * n]), np.array([[2.0] * n, [0.0] * n]), prior).sum(axis=(1, 3))
    of_noise = np.array([[(2 / 3 * 0.25 + 0.25**2 / 3) * np.e**3, 0.25 * 0.75 / 3 * np.e], [0.25 * 0.75 / 3 * np.e**2, 2 / 3 * 0.75 + 0.75**2 / 3]])
    assert both == pytest.approx(of_noise / of_noise.sum())


def test_fillets_along_the_whole_member_are_no_evidence_of_a_cap():
    def seen(n_side, n_like_caps):
        return Across(side=np.r_[np.full(n_side, 1.0), np.full(n_like_caps, 0.01)], cap=np.r_[np.full(n_side, 0.1), np.full(n_like_caps, 1.0)],
                      stray=np.full(n_side + n_like_caps, 1e-6))  # fmt: skip

    body = seen(900, 100)
    like = share_like_caps(body)
    assert like == pytest.approx(0.1, abs=0.03)

    def told(at):  # near an end where a fifth of the points would be a cap's
        n = len(at.side)
        at = at.with_like_caps(like)
        return told_across(np.full(n, 4.0), np.full(n, 1.0), 0.0, at) - told_across(np.full(n, 4.0), np.zeros(n), 0.0, at)

    assert told(body) < -20  # as many lie there as elsewhere
    assert told(seen(900, 350)) > 20


@pytest.mark.parametrize("caps", [False, True])
def test_walls_wider_than_the_noise_tell_whether_the_ends_were_scanned(caps):
    sigma, shape = 0.0015, section("L", L)
    expected = section_area(shape) * 8_000 / (face_lengths("L", np.array([0.15, 0.1, 0.012])).sum() * 1.8)
    z = []
    for seed in range(5):
        points = member_points("L", L, 8_000, MemberScanOptions(noise_m=sigma, seed=seed, caps=caps))
        found = find_ends(points, sigma, rough_ends(points[:, 2]), section_area(shape) / 0.5, look_at("L", (0.15, 0.1, 0.012), sigma))
        for end in (found.low, found.high):
            assert end.cap_points == pytest.approx(expected if caps else 0.0, rel=0.3)
        z.append((found.length_m - 1.8) / found.std_m)
        assert found.std_m < 1.8e-3  # area over perimeter is 5.7 mm; how far the noise reaches along the axis is not known beforehand
    assert np.abs(z).max() < 3.5


def test_where_no_one_can_tell_the_caps_the_length_owns_to_both_ends_at_once():
    thin = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
    ratio = section_area(section("L", thin)) / 0.508
    points = member_points("L", thin, 20_000, MemberScanOptions(noise_m=0.0067, seed=2))
    found = find_ends(points, 0.0067, rough_ends(points[:, 2]), ratio, look_at("L", (0.127, 0.127, 0.00635), 0.0067))
    edges = 2 * 0.0067 / (0.903 * 20_000 / 3.048)
    assert found.std_m > 0.7 * ratio  # both ends together are open by two of these: half of that
    assert found.std_m < 1.5 * np.hypot(ratio, np.sqrt(edges))
    assert abs(found.length_m - 3.048) < 1.96 * found.std_m
