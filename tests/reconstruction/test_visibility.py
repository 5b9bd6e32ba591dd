
import numpy as np
import pytest

import real_scans
from predicates import assert_closed_manifold_oriented, assert_no_crossing, l_beam, rotation, sphere, two_sided
from scan2fea.errors import ReconstructionError, UsageError
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction import ReconstructionOptions, reconstruct, visibility
from scan2fea.types import PointCloud, Scan
from scanned import scan_of, scanned

T = 0.00635


@pytest.fixture(scope="module")
def beam():
    mesh = l_beam(length=0.3)
    scan, _, _ = scanned(mesh, 0.004, 0.1 * T, seed=1)
    return mesh, scan, visibility(scan)


def test_thin_beam(beam):
    mesh, scan, found = beam
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.03)
    there, back = two_sided(found.mesh, mesh)
    assert max(np.percentile(there, 95), np.percentile(back, 95)) < 0.3 * found.spacing_m
    assert max(there.max(), back.max()) < 2.5 * found.spacing_m
    assert (found.source, found.sensor) == ("sensors", "known")
    assert all(check.passed for check in found.checks), found.checks
    assert found.sigma_m == pytest.approx(0.1 * T, rel=0.1)
    assert np.nanmedian(found.thickness_m) == pytest.approx(T, rel=0.03)
    assert len(found.points) == len(found.normals) == len(found.thickness_m) == len(scan.cloud)


def test_motion_and_scale(beam):
    mesh, scan, found = beam
    turn, scale, shift = rotation(4), 40.0, np.array([300.0, -200.0, 50.0])
    other = visibility(scan_of(scan.cloud.points @ turn.T * scale + shift, scan.sensors() @ turn.T * scale + shift))
    assert_closed_manifold_oriented(other.mesh)
    assert volume(other.mesh) == pytest.approx(volume(found.mesh) * scale**3, rel=0.005)
    assert (
        np.percentile(two_sided(other.mesh, type(mesh)(vertices=mesh.vertices @ turn.T * scale + shift, faces=mesh.faces))[0], 95)
        < 0.3 * other.spacing_m
    )


def test_same_input_same_bytes(beam):
    _, scan, found = beam
    before = scan.cloud.points.tobytes()
    again = visibility(scan)
    assert again.mesh.vertices.tobytes() == found.mesh.vertices.tobytes() and again.mesh.faces.tobytes() == found.mesh.faces.tobytes()
    assert scan.cloud.points.tobytes() == before


def test_false_sensors_are_rejected_and_the_flood_takes_over(beam):
    mesh, scan, _ = beam
    found = visibility(scan_of(scan.cloud.points, np.tile([1.0, 2.0, 3.0], (len(scan.cloud), 1))))
    assert (found.source, found.sensor) == ("outside flood", "rejected")
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.05)


def test_a_ball_without_sensors():
    mesh = sphere(1.0, rounds=5)
    scan, _, _ = scanned(mesh, 0.09, 0.005, seed=0)
    found = visibility(Scan(cloud=scan.cloud.replaced(ray=np.full(len(scan.cloud), -1))))
    assert (found.source, found.sensor) == ("outside flood", "unknown")
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.03)


def test_inferred_points_carry_the_surface_where_none_was_measured():
    mesh = l_beam(length=0.3)
    scan, places, normals = scanned(mesh, 0.004, 0.0, seed=2)
    hidden = (np.abs(places[:, 2] - 0.15) < 0.02) & (places[:, 1] < 0.5 * T)  # a band of one outer face that no sensor saw
    ray = np.where(hidden, -1, scan.cloud.ray)
    found = visibility(
        Scan(cloud=scan.cloud.replaced(ray=ray, normals=np.where(hidden[:, None], normals, np.nan), is_inferred=hidden), rays=scan.rays)
    )
    assert found.sensor == "known"
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_nonsense_is_closed_too(seed):
    """By construction, not by luck: points of no surface, sensors of no scanner."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(400, 3))
    try:
        found = visibility(scan_of(points, rng.normal(size=(400, 3)) * 5))
    except ReconstructionError:
        return
    assert_closed_manifold_oriented(found.mesh, n_components=int(found.checks[-1].value))
    assert not all(check.passed for check in found.checks)


def test_what_cannot_be_done_says_so():
    with pytest.raises(ReconstructionError, match="too few"):
        visibility(Scan(cloud=PointCloud.of(np.zeros((5, 3)))))
    with pytest.raises(ReconstructionError, match="coincide"):
        visibility(Scan(cloud=PointCloud.of(np.zeros((50, 3)))))
    with pytest.raises(ReconstructionError, match="not finite"):
        visibility(Scan(cloud=PointCloud.of(np.full((50, 3), np.nan))))
    with pytest.raises(UsageError, match="visibility"):
        reconstruct(Scan(cloud=PointCloud.of(np.zeros((50, 3)))), ReconstructionOptions(method="magic"))


def bunny(n_most):
    """Stanford bunny: scans in their own frames, placed by bun.conf; each looks along its -z, so its sensor is far off on +z."""
    folder = real_scans.DATA / "registration" / "stanford_bunny"
    points, sensors = [], []
    for line in (folder / "bun.conf").read_text().splitlines():
        word = line.split()
        if len(word) != 9 or word[0] != "bmesh" or not (folder / word[1]).exists():
            continue
        t, (x, y, z, w) = np.array(word[2:5], float), np.array(word[5:], float) * [-1, -1, -1, 1]
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        text = (folder / word[1]).read_text().split("end_header\n", 1)
        count = int(text[0].split("element vertex ")[1].split()[0])
        raw = np.array([row.split()[:3] for row in text[1].splitlines()[:count]], float)
        points.append(raw @ turn.T + t)
        sensors.append(points[-1] + 10 * turn[:, 2])
    cloud, origin = np.vstack(points), np.vstack(sensors)
    rows = np.random.default_rng(0).choice(len(cloud), n_most, replace=False)
    return cloud[rows], origin[rows]


@real_scans.needs("registration", "stanford_bunny")
def test_bunny():
    points, sensors = bunny(25_000)
    found = visibility(scan_of(points, sensors))
    assert found.sensor == "known", found.how
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(757e-6, rel=0.03)  # cubic metres, reference/reconstruction.md
