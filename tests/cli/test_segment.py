"""`scan2fea segment` end to end: files, picture, agreement with true labels, kind errors."""

import json

import numpy as np
import pytest
from PIL import Image

from scan2fea.cli.main import main
from scan2fea.io import read_scan
from scan2fea.io.scan_writers import SCAN_WRITERS
from scan2fea.simulation.control_sets import blobs
from scan2fea.types import PointCloud, Scan

PLAIN = ["--set", "segmentation.supports=false"]


@pytest.fixture(scope="module")
def heaps(tmp_path_factory):
    points, truth = blobs(200)
    path = tmp_path_factory.mktemp("blobs") / "blobs.ply"
    SCAN_WRITERS["ply"](path, Scan(cloud=PointCloud.of(points, label=truth)))
    return path


def test_segment_writes_labels_cloud_picture_and_report(heaps, tmp_path, capsys):
    outs = [tmp_path / "one", tmp_path / "two"]
    for out in outs:
        assert main(["segment", str(heaps), "-o", str(out), "--method", "kmeans", *PLAIN, "--labels", "label"]) == 0
    assert "3 segments of 600 points by kmeans" in capsys.readouterr().out
    report = json.loads((outs[0] / "report.json").read_text())
    assert report["agreement"]["adjusted_rand"] == 1.0
    assert [row["n_points"] for row in report["segments"]] == [200] * 3
    assert all("select.min_points" in row["why"] and row["object"] is None for row in report["segments"])
    labels = read_scan(outs[0] / "cloud.ply").scan.cloud.label
    assert np.bincount(labels).tolist() == [200] * 3
    assert len((outs[0] / "labels.csv").read_text().splitlines()) == 4
    assert Image.open(outs[0] / "segments.png").size[0] >= 600
    for name in ("cloud.ply", "labels.csv", "segments.png", "report.json", "config.toml"):
        assert (outs[0] / name).read_bytes() == (outs[1] / name).read_bytes()


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        (["--method", "kmeens"], 2, "did you mean 'kmeans'"),
        (["--method", "kmeans", "--set", "segmentation.clusters=1"], 2, "segmentation.clusters = 1: the least allowed is 2"),
        (["--method", "kmeans", "--set", "segmentation.clusters=601"], 4, "segmentation.clusters is 601, but the cloud has 600 points"),
        (["--method", "agglomerative", "--set", "segmentation.linkage=wards"], 2, "did you mean 'ward'"),
        (["--set", "segmentation.radius_m=500"], 4, "segmentation.radius_m is 500.0 m"),
        (["--set", "segmentation.radius_m=0"], 4, "segmentation.radius_m is 0.0 m"),
    ],
)
def test_bad_options_are_told_in_one_line(heaps, tmp_path, capsys, options, code, told):
    assert main(["segment", str(heaps), "-o", str(tmp_path / "out"), *PLAIN, *options]) == code
    said = capsys.readouterr().err
    assert told in said and said.count("\n") == 1


def test_segment_refuses_a_folder_of_others(heaps, capsys):
    assert main(["segment", str(heaps), "-o", str(heaps.parent)]) == 2
    assert "holds other files" in capsys.readouterr().err
