"""Real scans, where they are: the steel tee leaves its table, labels of a file are believed, a bunny of several scans is one object."""

from pathlib import Path

import numpy as np
import pytest

import real_scans
from scan2fea.filtering import clean_up
from scan2fea.io import InputOptions, read_mesh, read_scan
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.registration import RegistrationOptions, place, read_poses
from scan2fea.segmentation import SegmentationOptions, segment_scene, select
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation.shapes import posed
from scan2fea.types import PointCloud, Scan

DATA = real_scans.DATA
pytestmark = real_scans.needs("structural")


@pytest.mark.parametrize(("name", "x", "yaw"), [("table_8in10in_tee_x4y24_45.pcd", 0.1016, 45.0), ("table_8in10in_tee_x0y24.pcd", 0.0, 0.0)])
def test_the_tee_leaves_its_table(name, x, yaw):
    """Against the CAD at the stated pose, which is 8 mm off the true one (NOTES.md): within 15 mm counts as the tee."""
    scan = clean_up(read_scan(DATA / "structural/steel_tee" / name).scan).scan
    found = segment_scene(scan)
    cad = read_mesh(DATA / "structural/steel_tee/8in10in_tee_01.ply")
    tee = posed(cad, rigid(rotation_about((0, 0, 1), np.radians(yaw)), (x, -0.6096, 0.0254)))
    low, high = tee.vertices.min(axis=0) - 0.02, tee.vertices.max(axis=0) + 0.02
    box = ((scan.cloud.points > low) & (scan.cloud.points < high)).all(axis=1)
    is_tee = np.zeros(len(scan.cloud), bool)
    is_tee[box] = distance_to_mesh(scan.cloud.points[box], tee).distance < 0.015
    label = select(scan.cloud, found).labels[0]
    mine = found.labels == label
    assert (is_tee & mine).sum() / mine.sum() > 0.95
    clear_of_the_table = is_tee & (scan.cloud.points[:, 2] > 0.02)
    assert (clear_of_the_table & mine).sum() / clear_of_the_table.sum() > 0.99
    assert found.kinds[0] == "support"


def test_labels_of_the_file_are_believed():
    scan = read_scan(DATA / "structural/pc2beam/test_points.txt", InputOptions(labels="7")).scan
    found = segment_scene(scan, SegmentationOptions(method="given"))
    assert len(found.kinds) == len(np.unique(scan.cloud.label))
    for label in range(len(found.kinds)):
        assert len(np.unique(scan.cloud.label[found.labels == label])) == 1


def test_the_bunny_is_one_object():
    folder = DATA / "registration/stanford_bunny"
    files = [folder / name for name in ("bun000.ply", "bun090.ply", "bun180.ply", "bun270.ply")]
    names = [file.name for file in files]
    poses = str(folder / "bun.conf")
    scans = [Scan(cloud=cloud.take(np.arange(0, len(cloud), 3))) for cloud in (read_scan(file).scan.cloud for file in files)]  # a third tells as much
    placed = place(scans, read_poses(Path(poses), names), names, RegistrationOptions(poses=poses))
    assert placed.notes == ()
    assert placed.agreement_m.max() < 0.0008  # NOTES.md: 0.52 to 0.58 mm to the reference; a wrong convention gives over 20 mm
    found = segment_scene(placed.scan)
    assert select(placed.scan.cloud, found).labels == (0,)
    assert (found.labels == 0).mean() > 0.999


def test_girder_and_brace_part_and_the_girders_hidden_joint_does_not_part_it():
    scan = read_scan(DATA / "structural/pc2beam/test_points.txt", InputOptions(labels="7")).scan
    found = segment_scene(Scan(cloud=PointCloud.of(scan.cloud.points)))
    good = agreement(scan.cloud.label, found.labels)
    assert len(found.kinds) == 2
    assert good.iou.min() > 0.9


@pytest.mark.parametrize("turn", [0, 45, 60, 90])
def test_a_bent_profile_is_one_object_from_every_side(turn):
    """At 90 degrees its broad face was taken for a floor on which a leg stood that is seen in part."""
    scan = clean_up(read_scan(DATA / f"structural/steel_shape2/shape2_{turn}deg_filtered.pcd").scan).scan
    found = segment_scene(scan)
    assert found.kinds == ("object",)
    assert (found.labels == 0).mean() > 0.995
