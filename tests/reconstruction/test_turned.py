from dataclasses import replace

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, moved, rotation, sphere
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import area, face_normals, volume
from scan2fea.kernel.noise import noise_sigma
from scan2fea.kernel.side_normals import wall_depth
from scan2fea.reconstruction import visibility
from scan2fea.reconstruction.evidence import Evidence
from scan2fea.reconstruction.turned import axis_of, settled, with_turned
from scan2fea.simulation.polyhedra import meshed, prism
from scan2fea.simulation.shapes import chs, tank
from scan2fea.types import PointCloud
from scanned import scan_of, scanned

H = 0.008
TUBE = chs(0.12, 0.012, 0.3, 0.0001)  # about z, from 0 to 0.3
TANK = tank(0.15, 0.4, 0.012, 0.0004)
TURN, SHIFT = rotation(5), np.array([3.0, -2.0, 1.0])


def none_hidden(points, normals):
    return np.zeros(len(points), bool)


def evidence_of(mesh, hidden=none_hidden, n=6000, seed=1):
    """A first surface that is the truth itself, of exact points without those that `hidden` tells; each seen along a free line."""
    scan, points, normals = scanned(mesh, np.sqrt(0.85 * area(mesh) / n), seed=seed)
    keep = ~hidden(points, normals)
    points, normals, sensors = points[keep], normals[keep], scan.sensors()[keep]
    thickness, gap = wall_depth(points, normals, H, 12 * H), np.full(len(points), np.nan)
    known = {"thickness_m": thickness, "gap_m": gap, "spacing_m": H, "sigma_m": 0.0, "sensors": sensors}
    return PointCloud.of(points), Evidence(points=points, mesh=mesh, smoothed=points, normals=normals, **known)


def c_section(turn_deg):
    angle = np.radians(np.linspace(0.0, turn_deg, 90))
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    return meshed(prism(np.concatenate([0.06 * ring, 0.048 * ring[::-1]]).tolist(), 0.3))


@pytest.mark.parametrize("mesh", [TUBE, TANK], ids=["tube", "tank"])
def test_the_axis_is_found_to_the_chord_of_the_facets(mesh):
    points, face = sample_surface(moved(mesh, TURN, SHIFT), 6000, 0)
    normals = face_normals(moved(mesh, TURN, SHIFT))[face]
    axis = settled(axis_of(points, normals), points, normals, H, 0.0)
    assert abs(axis.way @ TURN[:, 2]) == pytest.approx(1.0, abs=1e-7)
    off = (axis.point - SHIFT) - (axis.point - SHIFT) @ TURN[:, 2] * TURN[:, 2]
    assert np.linalg.norm(off) < 1e-4


@pytest.mark.parametrize("mesh", [box((0.2, 0.15, 0.01)), box((0.1, 0.1, 0.3)), moved(sphere(1.0, rounds=4), 0.1 * np.eye(3), SHIFT)])
def test_what_has_many_axes_or_none_is_no_body_of_revolution(mesh):
    points, face = sample_surface(mesh, 4000, 0)
    normals = face_normals(mesh)[face]
    axis = axis_of(points, normals)
    assert axis is None or settled(axis, points, normals, H, 0.0) is None


@pytest.mark.parametrize("oval_m", [0.0, 0.002])
def test_noise_along_rays_hides_no_axis_and_an_oval_has_none(oval_m):
    """Seen square on a face is twice as noisy as beside it; an oval of four of its deviations is none."""
    points, face = sample_surface(TUBE, 20_000, 0)
    normals = face_normals(TUBE)[face]
    away = points[:, :2] / np.linalg.norm(points[:, :2], axis=1)[:, None]
    points[:, :2] += oval_m * np.cos(2.0 * np.arctan2(points[:, 1], points[:, 0]))[:, None] * away
    noise = 0.00025 * np.where(np.abs(normals[:, 2]) > 0.9, 1.0, 1.0 + (points[:, 2] > 0.15))
    points += (noise * np.random.default_rng(0).standard_normal(len(points)))[:, None] * normals
    found = settled(axis_of(points, normals), points, normals, np.sqrt(0.85 * area(TUBE) / len(points)), noise_sigma(points, normals))
    assert (found is None) == (oval_m > 0.0)


def test_a_gap_is_filled_from_its_own_rings_and_nothing_else_is():
    def hidden(points, normals):
        return np.linalg.norm(points - [0.06, 0.0, 0.15], axis=1) < 0.05

    assert with_turned(*evidence_of(TUBE)) is None
    cloud, evidence = evidence_of(TUBE, hidden)
    more = with_turned(cloud, evidence)
    new = more.points[len(cloud) :]
    assert more.is_inferred.sum() == len(new) and np.array_equal(more.points[: len(cloud)], cloud.points)
    assert PointToMesh(TUBE).nearest(new).distance.max() < 0.05 * H
    asked = sample_surface(TUBE, 20000, 3)[0]
    asked = asked[np.linalg.norm(asked - [0.06, 0.0, 0.15], axis=1) < 0.05]
    assert np.linalg.norm(asked[:, None] - np.concatenate([new, cloud.points]), axis=2).min(axis=1).max() < 1.6 * H
    places = {name: getattr(evidence, name) @ TURN.T + SHIFT for name in ("points", "smoothed", "sensors")}
    turned = replace(evidence, mesh=moved(TUBE, TURN, SHIFT), normals=evidence.normals @ TURN.T, **places)
    other = with_turned(PointCloud.of(turned.points), turned).points[len(cloud) :]
    assert len(other) == pytest.approx(len(new), rel=0.1)  # where stations begin is rounding
    assert with_turned(cloud, replace(evidence, sensors=None)) is None


def test_an_open_section_is_not_closed():
    for turn in (180.0, 240.0, 300.0):
        assert with_turned(*evidence_of(c_section(turn), n=4000)) is None


def test_a_rim_that_nobody_saw_lies_where_sight_lines_pass_beyond():
    def rim(points, normals):
        return normals[:, 2] > 0.9

    cloud, evidence = evidence_of(TUBE, rim)
    more = with_turned(cloud, evidence)
    new, out = more.points[len(cloud) :], more.normals[len(cloud) :]
    new = new[(out[:, 2] > 0.9) & (new[:, 2] > 0.15)]  # elsewhere chance left gaps
    assert np.abs(new[:, 2] - 0.3).max() < 0.1 * H and len(new) > 20
    longer = chs(0.12, 0.012, 0.4, 0.0001)  # cut off at the same place: no line passes where the wall goes on
    assert with_turned(*evidence_of(longer, lambda p, n: p[:, 2] > 0.3)) is None


def test_nothing_is_put_where_a_sight_line_passes_through_the_wall():
    def hidden(points, normals):
        return np.linalg.norm(points - [0.06, 0.0, 0.15], axis=1) < 0.05

    cloud, evidence = evidence_of(TUBE, hidden)
    # an opening there: what it shows of the far wall is seen from in front of it
    far = (evidence.points[:, 0] < 0) & (evidence.normals[:, 0] > 0.7) & (np.abs(evidence.points[:, 2] - 0.15) < 0.1)
    sensors = np.where(far[:, None], [2.0, 0.0, 0.15], evidence.sensors)
    more = with_turned(cloud, replace(evidence, sensors=sensors))
    new = np.zeros((0, 3)) if more is None else more.points[len(cloud) :]
    assert not (np.linalg.norm(new - [0.06, 0.0, 0.15], axis=1) < 0.02).any()


def test_a_tank_of_which_a_fifth_was_hidden_is_whole():
    scan, places, _ = scanned(moved(TANK, TURN, SHIFT), 0.009, 0.0006, seed=2)
    for way in (TURN[:, 0], TURN @ [0.3, 0.6, 0.7]):  # two balls, both faces of the wall
        middle = places[np.argmax(places @ way)]
        near = np.linalg.norm(scan.cloud.points - middle, axis=1) < 0.12
        scan, places = scan_of(scan.cloud.points[~near], scan.sensors()[~near]), places[~near]
    found = visibility(scan)
    assert found.how["carried"] == "round an axis" and all(check.passed for check in found.checks)
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(TANK), rel=0.015)


def test_the_other_face_of_a_wall_is_put_beside_rings_that_too_little_was_measured_of():
    """A tank of which a quarter of the rim and the middle of its bottom's inner face were not seen: neither gap is closed by one rule alone."""
    part = tank(0.15, 0.4, 0.012, 0.0004)
    scan, places, normals = scanned(part, 0.0084, seed=2)
    radius, angle = np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0])
    rim = (places[:, 2] > 0.36) & (angle > 0.0) & (angle < 1.5)
    middle = (radius < 0.06) & (places[:, 2] < 0.05) & (normals[:, 2] > 0)
    keep = ~rim & ~middle
    found = visibility(scan_of(scan.cloud.points[keep], scan.sensors()[keep]))
    assert found.how["carried"] == "round an axis, to the other face of walls"
    assert all(check.passed for check in found.checks) and volume(found.mesh) == pytest.approx(volume(part), rel=0.01)
