import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.bare_ends import BARE_ENDS, bare_ends
from scan2fea.reconstruction.evidence import Evidence
from scan2fea.reconstruction.gates import failed
from scan2fea.simulation.shapes import cylinder
from scan2fea.types import PointCloud, Scan, TriangleMesh
from scanned import DENSITY, scan_of, scanned

RADIUS, LENGTH, H = 0.06, 0.3, 0.006
POSE, PLACE = rotation(11), np.array([2.0, -1.0, 0.5])


def fine(mesh, size):
    """The mesh with its triangles divided until their edges are short: a surface between points has no large ones."""
    vertices, faces = mesh.vertices, mesh.faces
    while np.linalg.norm(vertices[faces[:, 1]] - vertices[faces[:, 0]], axis=1).max() > size:
        edges, number = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        middle = (len(vertices) + number.reshape(-1, 3)).astype(np.int64)
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return TriangleMesh(vertices=vertices, faces=faces)


def evidence_of(mesh, points):
    nan = np.full(len(points), np.nan)
    return Evidence(points=points, mesh=mesh, smoothed=points, normals=points, thickness_m=nan, gap_m=nan, spacing_m=H, sigma_m=0.0)


BAR = fine(cylinder(RADIUS, LENGTH, 1e-3), 4 * H)


def bar_points(ends):
    points, face = sample_surface(BAR, int(DENSITY * area(BAR) / H**2), 0)
    along = face_normals(BAR)[face][:, 2]
    return points[~((along < -0.9) & (ends < 2)) & ~((along > 0.9) & (ends < 1))]


@pytest.mark.parametrize("ends", [0, 1, 2])
@pytest.mark.parametrize("turn", [np.eye(3), POSE])
def test_ends_that_nobody_saw_are_counted_wherever_the_part_lies(ends, turn):
    check = bare_ends(evidence_of(moved(BAR, turn, PLACE), bar_points(ends) @ turn.T + PLACE))
    assert check.value == 2 - ends and check.passed is (ends == 2)
    assert check.passed or "may go on there, or be hollow" in check.says


@pytest.mark.parametrize(("rim", "n"), [(0.8, 2), (0.55, 0)])
def test_ends_of_which_the_rim_alone_was_seen(rim, n):
    """More than half of the plane lies in circles without a point: it may be the mouth of a tube. A smaller gap is one."""
    points = bar_points(2)
    is_end = np.minimum(points[:, 2] - BAR.vertices[:, 2].min(), BAR.vertices[:, 2].max() - points[:, 2]) < 1e-9
    seen = points[~is_end | (np.hypot(points[:, 0], points[:, 1]) > rim * RADIUS)]
    assert bare_ends(evidence_of(BAR, seen)).value == n


def test_a_gap_in_a_smooth_surface_is_no_end():
    """A flat cap over a gap of 40 degrees in a ball: the ball lies behind it, but the points round it look as it does."""
    ball = fine(TriangleMesh(vertices=np.vstack([np.eye(3), -np.eye(3)]), faces=OCTAHEDRON), 0.1)
    places = ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None]
    lid = np.cos(np.radians(20))
    flat = places * (lid / np.maximum(places[:, 2:], lid))
    mesh = TriangleMesh(vertices=0.3 * flat, faces=ball.faces)
    points, _ = sample_surface(mesh, int(DENSITY * area(mesh) / H**2), 0)
    assert bare_ends(evidence_of(mesh, points[points[:, 2] < 0.3 * lid * (1 - 1e-9)])).passed


OCTAHEDRON = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])


def test_a_bar_seen_from_the_side_alone_is_refused_and_one_seen_all_round_is_not():
    bar = moved(BAR, POSE, PLACE)
    scan, _, normals = scanned(bar, H, sigma=2e-4, seed=1)
    assert BARE_ENDS not in [check.name for check in failed(reconstruct(scan).checks)]
    side = np.abs(normals @ POSE[:, 2]) < 0.5
    assert BARE_ENDS in [check.name for check in failed(reconstruct(scan_of(scan.cloud.points[side], scan.sensors()[side])).checks)]


@pytest.mark.parametrize(("sigma", "sensors"), [(0.0, False), (2e-4, True)])
def test_points_on_one_cylinder_alone_are_refused_and_no_fault(sigma, sensors):
    rng = np.random.default_rng(0)
    points = bar_points(0)
    out = np.column_stack([points[:, :2] / RADIUS, np.zeros(len(points))])
    points = points + sigma * rng.standard_normal(points.shape)
    assert failed(reconstruct(scan_of(points, points + 3.0 * out) if sensors else Scan(cloud=PointCloud.of(points))).checks)
