"""[select] by label, kind, size, box and nearest point; each reason is told."""

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.segmentation import SelectOptions, select
from scan2fea.types import PointCloud, Segments


def scene():
    """A support and three cubes of edge 1, 2, 3 m at x = 10, 20, 30 with 30, 20, 10 points."""
    rng = np.random.default_rng(0)
    parts = [10 * rng.random((40, 3)) - [0, 0, 20]]
    for k, n in ((1, 30), (2, 20), (3, 10)):
        cube = rng.random((n, 3))
        cube[:2] = [[0, 0, 0], [1, 1, 1]]
        parts.append(k * cube + [10 * k, 0, 0])
    labels = np.repeat(np.arange(4), [len(p) for p in parts])
    return PointCloud.of(np.concatenate(parts)), Segments(labels=labels, kinds=("support", "object", "object", "object"), how={})


@pytest.mark.parametrize(
    ("options", "labels"),
    [
        ({}, (1, 2, 3)),
        ({"labels": (3, 0)}, (0, 3)),
        ({"kinds": ("support",)}, (0,)),
        ({"least_m": 2 * 3**0.5 - 1e-9}, (2, 3)),
        ({"least_m": 2 * 3**0.5 + 1e-9}, (3,)),
        ({"most_m": 2 * 3**0.5 + 1e-9}, (1, 2)),
        ({"box_m": (25.0, 5.0, 5.0, 9.0, -1.0, -1.0)}, (1, 2)),
        ({"box_m": (10.5, 0.5, 0.5, 10.5, 0.5, 0.5)}, (1,)),
        ({"near_m": (23.0, 2.0, 2.0)}, (2,)),
        ({"near_m": (23.0, 2.0, 2.0), "labels": (1, 3)}, (3,)),
    ],
)
def test_selects(options, labels):
    cloud, segments = scene()
    found = select(cloud, segments, SelectOptions(min_points=4, min_share=0.0, **options))
    assert found.labels == labels
    assert set(found.why) == {0, 1, 2, 3}
    for number, label in enumerate(found.labels, start=1):
        assert found.why[label] == f"to be modelled: object {number}"
    assert all(found.why[label].startswith("not modelled: ") for label in set(range(4)) - set(labels))


def test_a_label_that_is_not_there_is_told():
    with pytest.raises(UsageError, match=r"select\.labels \[7\]: the scene has the labels 0 to 3"):
        select(*scene(), SelectOptions(labels=(7,)))


def test_member_is_what_is_three_times_as_long_as_deep():
    sides = np.array([[1.0, 1, 0.5], [3.2, 1, 1], [2.8, 1, 1], [3.0, 3.0, 0.01]])  # a point in a hundred is left out at each end
    parts = [side * np.random.default_rng(k).random((4000, 3)) + 10 * k for k, side in enumerate(sides)]
    cloud = PointCloud.of(np.concatenate(parts))
    labels = np.repeat(np.arange(4), 4000)
    for roles, wanted in ((("object",) * 4, (1,)), (("object", "support", "object", "object"), ())):
        found = select(cloud, Segments(labels=labels, kinds=roles, how={}), SelectOptions(kinds=("member",)))
        assert found.labels == wanted
    assert found.why[0] == "not modelled: no member: less than three times as long as deep (select.kinds)"


def workshop(n_members=2, gap=0.0, beside=1.0):
    """A floor, so many bars 2 m long that hang over it, and a box `gap` above the floor, `beside` from a post. Names as guessed."""
    rng = np.random.default_rng(3)

    def box(size, at, n):
        points = rng.random((n, 3))
        points[np.arange(n), rng.integers(0, 3, n)] = rng.integers(0, 2, n)
        return points * size + at

    parts = [np.c_[4 * rng.random((8000, 2)), np.zeros(8000)], box([0.5, 0.5, 0.4], [2.0, 2.0, gap], 4000)]
    parts += [box([2.0, 0.1, 0.1], [0.5, 0.5 * k, 1.0], 3000) for k in range(n_members)]
    parts += [box([0.1, 0.1, 0.2], [2.5 + beside, 2.0, 0.0], 1000)]
    names = ("floor", "box", *("I",) * n_members, "T")
    labels = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
    roles = ("support", *("object",) * (n_members + 1), "object")
    return PointCloud.of(np.concatenate(parts)), Segments(labels=labels, kinds=roles, how={}), names


@pytest.mark.parametrize(
    ("scene", "options", "is_left_out"),
    [
        ({}, {}, True),
        ({"n_members": 1}, {}, False),  # no structure
        ({"gap": 0.5}, {}, False),  # hangs
        ({"beside": 0.01}, {}, False),  # something leans on it
        ({}, {"furnishing": True}, False),
        ({}, {"kinds": ("box", "I")}, False),
        ({}, {"labels": (1,)}, False),
        ({}, {"near_m": (2.0, 2.0, 0.2)}, False),
    ],
)
def test_a_box_that_stands_free_in_a_scene_of_members_is_furniture(scene, options, is_left_out):
    cloud, segments, names = workshop(**scene)
    found = select(cloud, segments, SelectOptions(min_share=0.0, **options), names=names)
    assert (1 not in found.labels) == is_left_out
    assert not is_left_out or ("stands free on the floor" in found.why[1] and len(found.labels) == len(names) - 2)


def test_nothing_is_furniture_whose_kind_is_not_known_or_whose_row_a_person_has_edited():
    cloud, segments, names = workshop()
    assert 1 in select(cloud, segments).labels
    assert 1 in select(cloud, segments, names=("floor", "object", *names[2:])).labels
    edited = Segments(labels=segments.labels, kinds=segments.kinds, how={"edited": True})
    assert 1 in select(cloud, edited, names=names).labels
