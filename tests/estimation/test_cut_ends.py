"""A web that was cut, under noise that joins its two faces: where it ends is no toe, for a toe has points of its own."""

import pytest

from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import open_walls

TEE = {"h": 0.06, "b": 0.0552, "tw": 0.00472, "tf": 0.0064, "length": 0.55}
SIGMA = TEE["tw"] / 3.75


def fitted(points):
    return fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions()).member


@pytest.mark.parametrize("seed", [2, 3, 6])
def test_a_cut_web_has_no_toe_and_a_whole_one_has(seed) -> None:
    """An I of which half was scanned was built as a tee whose height was how far the scan reached. Told of 8 in 10 cuts; of none under 2.5 sigma."""
    options = MemberScanOptions(noise_m=SIGMA, caps=True, seed=seed)
    longer = member_points("T", {**TEE, "h": 0.09}, 7000, options)
    cut = fitted(longer[longer[:, 1] > longer[:, 1].min() + 0.03])
    height = next(p for p in cut.parameters if p.name == "h")
    assert cut.family == "T" and cut.seen["WEB_TOE"] == 0 and not height.observable and open_walls(cut) == 1
    whole = fitted(member_points("T", TEE, 5000, options))
    height = next(p for p in whole.parameters if p.name == "h")
    assert whole.seen["WEB_TOE"] > 0.5 and height.observable and abs(height.value_m - TEE["h"]) < 4 * height.std_m


@pytest.mark.parametrize("walls", [4.5, 6.5])
def test_the_noise_of_two_faces_and_strays_are_no_toe_between_them(walls) -> None:
    """A wall that was cut ends among its own noise and strays, which had counted as points of a toe: h was told 58.8 for 90 mm, cut at 60."""
    options = MemberScanOptions(noise_m=TEE["tw"] / walls, caps=True, seed=2, clutter=0.15)
    longer = member_points("T", {**TEE, "h": 0.09}, 12_000, options)
    cut = fitted(longer[longer[:, 1] > -0.06])
    assert cut.seen["WEB_TOE"] == 0 and not next(p for p in cut.parameters if p.name == "h").observable
    whole = fitted(member_points("T", TEE, 9_000, options))
    assert whole.seen["WEB_TOE"] > 0.5 and next(p for p in whole.parameters if p.name == "h").observable
