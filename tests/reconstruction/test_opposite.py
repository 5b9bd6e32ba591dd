from dataclasses import replace

import numpy as np
import pytest

from predicates import box, moved, rotation
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.side_normals import wall_depth
from scan2fea.reconstruction import visibility
from scan2fea.reconstruction.evidence import Evidence
from scan2fea.reconstruction.opposite import with_opposite
from scan2fea.reconstruction.visibility import opened_holes
from scan2fea.simulation.shapes import chs
from scan2fea.types import PointCloud, TriangleMesh
from scanned import scan_of, scanned

H, T = 0.03, 0.06
PLATE = box((1.2, 0.8, T))


def evidence_of(mesh, hidden, sensors=None, n=9000):
    """A first surface that is the truth itself, of exact points without those that `hidden` tells."""
    points, face = sample_surface(mesh, n, 1)
    normals = face_normals(mesh)[face]
    keep = ~hidden(points, normals)
    points, normals = points[keep], normals[keep]
    every = points + 5.0 * normals if sensors is None else sensors(points, normals)
    thickness, gap = wall_depth(points, normals, H, 12 * H), np.full(len(points), np.nan)
    known = {"thickness_m": thickness, "gap_m": gap, "spacing_m": H, "sigma_m": 0.0, "sensors": every}
    return PointCloud.of(points), Evidence(points=points, mesh=mesh, smoothed=points, normals=normals, **known)


def under(points, normals, half=0.2):
    return (normals[:, 2] < -0.5) & (np.abs(points[:, :2] - [0.6, 0.4]) < half).all(axis=1)


def test_the_hidden_face_of_a_plate_is_put_where_it_is():
    cloud, evidence = evidence_of(PLATE, under)
    more = with_opposite(cloud, evidence)
    new, out = more.points[len(cloud) :], more.normals[len(cloud) :]
    assert more.is_inferred.sum() == len(new) and (more.ray[len(cloud) :] == -1).all() and np.array_equal(more.points[: len(cloud)], cloud.points)
    assert np.abs(new[:, 2]).max() < 1e-9 and (out[:, 2] < -0.99).all()  # the under side lies at 0
    inner = np.stack(np.meshgrid(np.linspace(0.43, 0.77, 18), np.linspace(0.23, 0.57, 18), [0.0]), axis=-1).reshape(-1, 3)
    assert np.linalg.norm(inner[:, None] - new, axis=2).min(axis=1).max() < 1.5 * H
    turn, shift = rotation(3), np.array([4.0, -2.0, 7.0])
    places = {name: getattr(evidence, name) @ turn.T + shift for name in ("points", "smoothed", "sensors")}
    turned = replace(evidence, mesh=moved(PLATE, turn, shift), normals=evidence.normals @ turn.T, **places)
    other = with_opposite(PointCloud.of(turned.points), turned).points[len(cloud) :]
    assert len(other) == pytest.approx(len(new), abs=3)  # which points lie just within reach is rounding


def test_nothing_is_put_where_nothing_tells_the_thickness():
    assert with_opposite(*evidence_of(PLATE, lambda p, n: np.zeros(len(p), bool))) is None  # nothing is hidden
    assert with_opposite(*evidence_of(PLATE, lambda p, n: n[:, 2] < -0.5)) is None  # no border: the other face was not seen at all
    assert with_opposite(*evidence_of(PLATE, lambda p, n: under(p, n, 0.37))) is not None
    assert with_opposite(*evidence_of(PLATE, lambda p, n: (n[:, 2] < -0.5) & (p[:, 0] < 0.7))) is None  # a gap larger than what was measured
    wedge = PLATE.vertices * [1, 1, 1] + np.where(PLATE.vertices[:, 2:] > T / 2, PLATE.vertices[:, :1] * [0, 0, 0.1], 0.0)
    assert with_opposite(*evidence_of(TriangleMesh(vertices=wedge, faces=PLATE.faces), under)) is None  # 60 to 180 mm thick
    bowl = PLATE.vertices * [1, 1, 8]  # as thick as the reach in which other faces are looked for, and more: flat still
    assert with_opposite(*evidence_of(TriangleMesh(vertices=bowl, faces=PLATE.faces), under)) is not None


def test_sight_lines_pass_through_no_wall():
    def from_the_side(points, normals):
        sensors = points + 5.0 * normals
        rim = np.abs(normals[:, 2]) < 0.5
        sensors[rim] = points[rim] - 20.0 * normals[rim]  # through the plate: there is no wall there
        return sensors

    assert with_opposite(*evidence_of(PLATE, under, from_the_side)) is None


def test_a_tube_of_which_a_side_was_hidden():
    wall = 0.006
    truth = moved(chs(0.06, wall, 0.12, 0.0002), rotation(5), np.array([1.0, 2.0, 3.0]))
    scan, exact, normals = scanned(truth, 0.45 * wall, 0.05 * wall, seed=3)
    middle = exact[np.argmax(exact @ normals[0])]
    gone = (np.linalg.norm(exact - middle, axis=1) < 0.025) & (normals @ normals[0] > 0.2)
    assert 100 < gone.sum() < 0.1 * len(exact)
    found = visibility(scan_of(scan.cloud.points[~gone], scan.sensors()[~gone]))
    off = PointToMesh(truth).nearest(found.carried).distance
    assert len(found.carried) > 50 and np.percentile(off, 95) < 0.15 * wall
    assert all(check.passed for check in found.checks), [check.name for check in found.checks if not check.passed]
    assert volume(found.mesh) == pytest.approx(volume(truth), rel=0.01)
    assert len(found.points) == (~gone).sum() and found.how["n_carried"] == len(found.carried)


def test_faces_put_where_nobody_saw_them_open_no_hole():
    """A lipped Z passed with three holes that its first surface did not have, where few rays met the outer face of the lip."""
    tube = chs(0.06, 0.004, 0.25, 0.0005)
    (check,) = opened_holes(PLATE, tube)
    assert check.value == 1.0 and not check.passed
    assert opened_holes(tube, PLATE) == () == opened_holes(tube, tube)
