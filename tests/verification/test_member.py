"""Checks of a fitted member: each fails on its own, at its limit it holds."""

from dataclasses import replace

import numpy as np
import pytest

from scan2fea.types import CatalogueEntry, Member, Parameter
from scan2fea.verification.limits import limits
from scan2fea.verification.member import member_checks, open_walls, relative_volume_std

LENGTH = 2.0


def angle(std_m: float = 1e-4, families: dict[str, float] | None = None, hidden: tuple[str, ...] = ()) -> Member:
    sizes = {"a": 0.16, "b": 0.1, "t": 0.012, "length": LENGTH}
    told = tuple(
        Parameter(name=n, value_m=v, std_m=None if n in hidden else std_m, observable=n not in hidden, source="fitted") for n, v in sizes.items()
    )
    return Member(
        family="L", parameters=told, T_world_member=np.eye(4), bow=np.zeros((2, 0)), twist=np.zeros(0),
        end_normals=np.array([[0.0, 0, -1], [0, 0, 1]]), covariance=np.eye(4) * std_m**2, sigma_m=1e-3, noise="gaussian", outlier_share=0.0,
        seen={}, families=families or {"L": 1.0}, inside="solid",
    )  # fmt: skip


def failed(member: Member, explains: bool = True) -> list[str]:
    return [check.name for check in member_checks(member, explains) if not check.passed]


def test_a_member_that_is_known_passes() -> None:
    assert failed(angle()) == []


def test_each_check_fails_alone() -> None:
    assert failed(angle(), explains=False) == ["member.unexplained"]
    limit = float(limits()["member.family"]["limit"])
    assert failed(angle(families={"L": limit, "rect": 1 - limit})) == []
    assert failed(angle(families={"L": limit - 1e-9, "rect": 1 - limit})) == ["member.family"]
    assert failed(angle(hidden=("a",))) == ["member.unseen_dimensions"]
    assert failed(angle(hidden=("length",))) == ["member.length"]
    assert failed(angle(std_m=3e-3)) == ["member.volume_std"]


def test_a_wall_in_the_noise_is_refused_unless_it_was_given() -> None:
    member = angle(hidden=("t",))
    assert failed(member) == ["member.walls_in_noise"]
    given = replace(member.parameters[2], observable=True, source="fixed")
    assert failed(replace(member, parameters=(*member.parameters[:2], given, member.parameters[3]))) == []


def test_a_wall_in_the_noise_of_a_standard_section_is_its_own() -> None:
    def entries(p: float) -> tuple[CatalogueEntry, ...]:
        size = CatalogueEntry(name="L160x100x12", probability=p, parameters={}, is_standard=True)
        return (size, CatalogueEntry(name="no size of the table", probability=1 - p, parameters={}))

    assert failed(replace(angle(hidden=("t",)), catalogue=entries(0.95))) == []
    assert failed(replace(angle(hidden=("t",)), catalogue=entries(0.949))) == ["member.walls_in_noise"]
    assert member_checks(angle(hidden=("t",)), True, given=True)[4].passed


def test_a_bar_that_may_be_a_tube_is_refused_unless_named() -> None:
    member = replace(angle(), inside="unknown")
    assert failed(member) == ["member.inside_unknown"]
    assert all(check.passed for check in member_checks(member, True, given=True))


def test_the_side_of_a_bar_is_no_wall() -> None:
    sizes = {"b": 0.1, "t": 0.02, "length": 1.0}
    told = tuple(Parameter(name=n, value_m=v, std_m=None, observable=n != "t", source="fitted") for n, v in sizes.items())
    bar = replace(angle(), family="rect", parameters=told, covariance=np.zeros((3, 3)), families={"rect": 1.0})
    assert failed(bar) == ["member.unseen_dimensions"]


def test_the_wall_of_a_tube_may_come_from_the_catalogue() -> None:
    sizes = {"d": 0.1, "t": 0.004, "length": 1.0}
    told = tuple(Parameter(name=n, value_m=v, std_m=None, observable=n != "t", source="fitted") for n, v in sizes.items())
    assert failed(replace(angle(), family="CHS", parameters=told, covariance=np.zeros((3, 3)), families={"CHS": 1.0})) == []


def test_the_volume_s_deviation_is_the_closed_form() -> None:
    """A = t (a + b - t); V = A L."""
    a, b, t, s = 0.16, 0.1, 0.012, 1e-4
    area = t * (a + b - t)
    slopes = np.array([t * LENGTH, t * LENGTH, (a + b - 2 * t) * LENGTH, area])
    assert relative_volume_std(angle(s)) == pytest.approx(s * float(np.linalg.norm(slopes)) / (area * LENGTH), rel=1e-9)


def test_what_was_not_estimated_adds_nothing() -> None:
    member = angle()
    assert relative_volume_std(replace(member, covariance=np.zeros((4, 4)))) == 0.0


def test_a_wall_without_an_end_is_refused() -> None:
    assert failed(replace(angle(), seen={"A_TOE": 0.1, "B_TOE": 1.0})) == []
    assert failed(replace(angle(), seen={"A_TOE": 0.099, "B_TOE": 1.0})) == ["member.open_walls"]
    assert failed(replace(angle(), seen={"A_OUTER": 0.0, "B_OUTER": 1.0})) == ["member.open_walls"]


def test_an_i_of_which_nothing_of_half_a_flange_was_seen_is_open() -> None:
    halves = [(f"{flange}_TOE_{side}", f"{flange}_INNER_{side}") for flange in ("BOTTOM", "TOP") for side in ("RIGHT", "LEFT")]
    whole = dict.fromkeys([name for half in halves for name in half], 1.0) | {"BOTTOM_OUTER": 1.0, "TOP_OUTER": 1.0}
    z = whole | dict.fromkeys((*halves[1], *halves[2]), 0.0) | {"BOTTOM_OUTER": 0.54, "TOP_OUTER": 0.54}
    j = whole | dict.fromkeys(halves[2], 0.0) | {"TOP_OUTER": 0.54}
    assert open_walls(replace(angle(), family="I", seen=whole)) == 0
    assert open_walls(replace(angle(), family="I", seen=z)) == 1
    assert open_walls(replace(angle(), family="I", seen=j)) == 1
    assert open_walls(replace(angle(), family="I", seen={**j, "TOP_OUTER": 0.75})) == 0  # it goes on beyond the web
    assert open_walls(replace(angle(), family="I", seen={**j, "TOP_INNER_RIGHT": 1.0})) == 0
    assert open_walls(replace(angle(), family="I", seen=j, reached=("TOP_TOE_RIGHT",))) == 0
