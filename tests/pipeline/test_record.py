import numpy as np

from scan2fea.pipeline import record
from scan2fea.pipeline.config import RunOptions
from scan2fea.pipeline.record import Record, Tracked
from scan2fea.types import PointCloud, Rays, Scan


def double(cloud, options):
    double.calls += 1
    return cloud.replaced(points=2 * cloud.points)


double.calls = 0
CLOUD = PointCloud.of([[1, 2, 3], [4, 5, 6]])


def run(folder, *, resume, key="k", seed=0):
    own = Record(folder, resume=resume)
    return own("double it", double, Tracked(CLOUD, key), options=RunOptions(seed=seed), n_in=2, count=len), own


def test_result_is_kept_for_the_same_key_only(tmp_path):
    double.calls = 0
    first, _ = run(tmp_path, resume=False)
    again, kept = run(tmp_path, resume=True)
    assert double.calls == 1
    assert np.array_equal(again.value.points, first.value.points)
    assert again.key == first.key
    assert kept.stages[0]["n_out"] == 2
    run(tmp_path, resume=True, key="other")
    run(tmp_path, resume=True, seed=1)
    run(tmp_path, resume=False)
    assert double.calls == 4


def test_what_another_program_made_is_made_again(tmp_path, monkeypatch):
    assert len(record.program()) == 64
    run(tmp_path, resume=False)
    double.calls = 0
    monkeypatch.setattr(record, "program", lambda: "another")
    run(tmp_path, resume=True)
    run(tmp_path, resume=True)
    assert double.calls == 1


def test_damaged_result_is_made_again(tmp_path):
    run(tmp_path, resume=False)
    for path in tmp_path.glob("*.npz"):
        path.write_bytes(path.read_bytes()[:100])
    double.calls = 0
    run(tmp_path, resume=True)
    assert double.calls == 1


def test_events_come_in_order(tmp_path):
    seen = []
    Record(tmp_path, say=seen.append, label="3")("a", double, Tracked(CLOUD, "k"), options=RunOptions())
    assert [(e["event"], e["object"]) for e in seen] == [("begin", "3"), ("end", "3")]


def test_compact_keeps_only_the_rays_of_its_points():
    rays = Rays(origin=np.arange(12.0).reshape(4, 3), direction=np.tile([0.0, 0, 1], (4, 1)), range_m=np.arange(4.0))
    cloud = PointCloud.of(np.zeros((3, 3)), ray=np.array([3, -1, 1]))
    scan = Scan(cloud=cloud, rays=rays)
    small = scan.compact()
    assert len(small.rays) == 2
    assert np.array_equal(small.sensors(), scan.sensors(), equal_nan=True)
