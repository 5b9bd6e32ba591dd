"""An object that was refused is taken for members that meet: they take its place where they hold it, and it stays refused where they do not."""

import numpy as np
import pytest

from scan2fea.pipeline.config import Config
from scan2fea.pipeline.convert import convert
from scan2fea.pipeline.joints import with_joined
from scan2fea.pipeline.known import KnownObject
from scan2fea.pipeline.part import Part
from scan2fea.pipeline.record import Record
from scan2fea.pipeline.scene import Scene
from scan2fea.pipeline.segment_rows import segment_rows
from scan2fea.segmentation import Selection
from scan2fea.segmentation.kinds import Guess
from scan2fea.types import PointCloud, Scan, Segments, Trajectory
from welded import tee


@pytest.fixture(scope="module")
def node():
    """A scene of one object, a tee: the arguments of `with_joined` but for the rows."""
    points = np.concatenate(tee(np.random.default_rng(3)))
    scan = Scan(cloud=PointCloud.of(points).replaced(frame=np.zeros(len(points), np.int64)))
    way = Trajectory(T_world_frame=np.eye(4)[None], placed=np.ones(1, bool))
    one, none = np.zeros(1), np.zeros(3)
    empty = {"meshes": (), "reasons": ("",), "links": (), "notes": ()}
    scene = Scene(scan=scan, trajectory=way, shift_m=none, spacing_m=0.005, agreement_m=one, std_m=one, std_rad=one, **empty)
    segments = Segments(labels=np.zeros(len(points), np.int64), kinds=("object",), how={})
    return scene, segments, Selection(labels=(0,), notes=()), [Part(id=1, kind="object", scan=scan)]


def converter(verdicts, seen):
    """Rows with the verdicts by number; the parts and configurations that were given are kept."""

    def convert(parts, config):
        seen.append((parts, config))
        return [{"id": p.id, "n_points": len(p.scan.cloud), "verdict": verdicts[p.id], "reason": f"reason {p.id}"} for p in parts], [{}]

    return convert


REFUSED = {"id": 1, "verdict": "failed", "reason": "open"}


def test_members_take_the_place_of_what_was_refused(node):
    seen = []
    config = Config(object=(KnownObject(id=1, family="RHS", fixed={"t": 0.003}),))
    rows, stages, chosen = with_joined(*node, [REFUSED], config, converter({2: "converted", 3: "converted"}, seen))
    assert [row["id"] for row in rows] == [2, 3]
    assert chosen.labels == (0, 0, 0)  # number -> label, for each that may be asked for
    (row,) = segment_rows(node[0].scan.cloud, node[1], chosen, [Guess(kind="unknown", confidence=0.3)])
    assert row["object"] == 2 and row["why"].endswith("objects 2, 3")
    assert len(stages) == 2  # one of each
    assert "objects 2, 3" in rows[0]["reason"]
    pieces = [part for parts, _ in seen for part in parts]
    assert all(part.cut_from == 1 for part in pieces)
    assert sum(len(part.scan.cloud) for part in pieces) >= 0.99 * len(node[0].scan.cloud)
    assert [one.id for one in seen[0][1].object] == [2, 3]  # what is known of it is known of each
    assert all(one.fixed == {"t": 0.003} for one in seen[0][1].object)


@pytest.mark.parametrize("verdicts", [{2: "failed", 3: "converted"}, {2: "converted", 3: "failed"}])
def test_what_one_of_them_does_not_explain_stays_refused(node, verdicts):
    seen = []
    rows, _, chosen = with_joined(*node, [REFUSED], Config(), converter(verdicts, seen))
    assert [row["id"] for row in rows] == [1]
    assert rows[0]["verdict"] == "failed"
    assert "nor is it 2 members that meet" in rows[0]["reason"]
    assert chosen.labels == (0,)
    assert len(seen) == (1 if verdicts[2] == "failed" else 2)  # without the largest the others are not asked for


@pytest.mark.parametrize(
    ("row", "config"),
    [
        ({**REFUSED, "verdict": "converted"}, Config()),
        (REFUSED, Config(object=(KnownObject(id=1, family="RHS", fixed={"length": 0.3}),))),
        (REFUSED, Config(object=(KnownObject(id=1, step="tee.step"),))),
    ],
)
def test_what_passed_or_is_known_as_a_whole_costs_nothing(node, row, config):
    rows, stages, chosen = with_joined(*node, [row], config, converter({}, []))
    assert rows == [row]
    assert stages == []
    assert chosen is node[2]


def test_a_piece_that_is_no_member_is_no_free_form_either(tmp_path):
    """A ball would be one: but where a piece was cut off its neighbour free form would close it."""
    way = np.random.default_rng(0).standard_normal((3000, 3))
    part = Part(id=2, kind="object", scan=Scan(cloud=PointCloud.of(0.1 * way / np.linalg.norm(way, axis=1)[:, None])), cut_from=1)
    row = convert(part, "key", Config(), Record(tmp_path / "keep", resume=False, say=lambda event: None), tmp_path / "out")
    assert row["verdict"] == "failed"
    assert "no member" in row["reason"]
