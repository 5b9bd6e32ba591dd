import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.pipeline.labels import edited, labels_text, read_rows
from scan2fea.types import Segments

POINTS = np.array([[0, 0, 0], [0.1, 0, 0], [5, 0, 0], [5.1, 0, 0], [9, 0, 0]], float)
SEGMENTS = Segments(labels=np.array([0, 0, 1, 1, 2]), kinds=("object", "support", "clutter"), how={})


def after(tmp_path, old, new):
    path = tmp_path / "labels.csv"
    text = labels_text(SEGMENTS, POINTS)
    assert old in text
    path.write_text(text.replace(old, new))
    return edited(SEGMENTS, POINTS, read_rows(path))


def test_unedited_changes_nothing(tmp_path):
    found = after(tmp_path, "label", "label")
    assert found.labels.tolist() == SEGMENTS.labels.tolist()
    assert found.kinds == SEGMENTS.kinds


def test_merge(tmp_path):
    found = after(tmp_path, "2,clutter,1,9.0000,0.0000,0.0000,0.0000,,", "2,clutter,1,9.0000,0.0000,0.0000,0.0000,0,")
    assert found.labels.tolist() == [0, 0, 1, 1, 0]
    assert found.kinds == ("object", "support")


def test_drop_and_kind(tmp_path):
    found = after(tmp_path, "0,object", "0,drop")
    assert found.labels.tolist() == [-1, -1, 0, 0, 1]
    assert after(tmp_path, "1,support", "1,object").kinds[1] == "object"


@pytest.mark.parametrize(("radius", "labels"), [("0.05", [0, 3, 1, 1, 2]), ("0.1", [0, 0, 1, 1, 2])])
def test_split_at_the_radius_keeps_together(tmp_path, radius, labels):
    row = "0,object,2,0.0500,0.0000,0.0000,0.1000,,"
    found = after(tmp_path, row, row + radius)
    assert found.labels.tolist() == labels


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("0,object", "7,object", "label 7 does not exist"),
        ("0,object", "0,thing", "kind 'thing'"),
        ("0,object", "x,object", "line 2"),
        ("0.0000,0.1000,,", "0.0000,0.1000,,-1", "must be positive"),
    ],
)
def test_wrong_edits_are_told(tmp_path, old, new, told):
    with pytest.raises(InputError, match=told):
        after(tmp_path, old, new)


def test_circle_is_told(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("label,kind,merge_into\n0,object,1\n1,object,0\n")
    with pytest.raises(InputError, match="circle"):
        edited(SEGMENTS, POINTS, read_rows(path))
