import numpy as np
import pytest
from scipy import stats

from scan2fea.errors import InputError
from scan2fea.io import InputOptions, read_scan
from scan2fea.kernel.transforms import applied
from scan2fea.pipeline.simulate import simulate_scene
from scan2fea.simulation.casting import target_of
from scan2fea.simulation.photogrammetry import (
    CameraOptions,
    PhotogrammetryOptions,
    SfmOptions,
    StereoOptions,
    features_of,
    in_frame,
    scan_photogrammetry,
    scan_stereo,
    sfm_frame,
)
from scan2fea.simulation.scene_file import scene_of
from sensed import block, scene

HERE = {"positions_m": ((0.0, 0.0, 0.0),)}


def wall(distance):
    return scene(block((distance, -6, -6), (distance + 1, 6, 6)))


@pytest.mark.parametrize(("distance", "baseline"), [(4.0, 0.5), (8.0, 0.5), (8.0, 1.0)])
def test_depth_error_of_a_stereo_pair_grows_with_range_squared_over_baseline(distance, baseline):
    """sigma_z = z^2 / (f b) sqrt(2) sigma_px for a rectified pair (the disparity has both pictures' error)."""
    options = StereoOptions(
        baseline_m=baseline, features_per_m2=300.0, bare_share=0.0, noise_px=0.3, focal_px=2000.0, width_px=1500, height_px=1500, **HERE
    )
    (scan,) = scan_stereo(wall(distance), options, 1)
    sigma = distance**2 / (2000.0 * baseline) * np.sqrt(2) * 0.3
    off = scan.cloud.points[:, 0] - distance
    assert len(off) > 1000
    assert stats.kstest(off / sigma, "norm").pvalue > 0.01
    assert off.std() == pytest.approx(sigma, rel=0.06)


def test_stated_deviations_are_those_of_the_scatter():
    """Convergent cameras all about: what is along the ray and across it, in units of the stated deviations, is standard normal."""
    about = np.radians([-50, -25, 0, 25, 50])
    options = PhotogrammetryOptions(
        positions_m=tuple((5 - 5 * np.cos(a), 5 * np.sin(a), 0.4 * k) for k, a in enumerate(about)),
        orientations_deg=tuple((0, 0, -np.degrees(a)) for a in about),
        features_per_m2=400.0,
        bare_share=0.0,
        width_px=3000,
        height_px=2000,
        focal_px=1500.0,
    )
    small = scene(block((4.9, -1, -1), (5.1, 1, 1)))
    (scan,) = scan_photogrammetry(small, options, 2)
    exact = scan_photogrammetry(small, PhotogrammetryOptions(**{**vars(options), "noise_px": 0.0}), 2)[0].cloud.points
    assert len(exact) == len(scan.cloud) > 600
    direction = scan.rays.direction
    off = scan.cloud.points - exact
    along = np.einsum("nc,nc->n", off, direction)
    across = off - along[:, None] * direction
    assert (along / scan.cloud.sigma_along_m).std() == pytest.approx(1, abs=0.08)
    assert np.mean((across**2).sum(1) / (2 * scan.cloud.sigma_across_m**2)) == pytest.approx(1, abs=0.12)


def test_without_noise_points_lie_on_the_surface():
    options = PhotogrammetryOptions(positions_m=((0, 0, 0), (0, 1, 0), (0, 0, 1)), noise_px=0.0, features_per_m2=50.0)
    (scan,) = scan_photogrammetry(wall(5.0), options)
    assert len(scan.cloud) > 50
    np.testing.assert_allclose(scan.cloud.points[:, 0], 5, atol=1e-10)
    np.testing.assert_allclose(scan.rays.origin + scan.rays.range_m[:, None] * scan.rays.direction, scan.cloud.points, atol=1e-12)


def test_only_what_two_cameras_see_becomes_a_point():
    """A post hides a strip of the wall from either camera: the strips of both are missing."""
    room = scene(block((5, -3, -1), (5.2, 3, 1)), block((2.5, -0.05, -1), (2.6, 0.05, 1)))
    options = StereoOptions(baseline_m=1.0, noise_px=0.0, features_per_m2=2000.0, bare_share=0.0, **HERE)
    (scan,) = scan_stereo(room, options)
    on = scan.cloud.points[scan.cloud.label == 0]
    y = on[np.abs(on[:, 0] - 5) < 1e-9, 1]
    for side in (1, -1):  # from y = side / 2 the post's shadow is cast on the other half
        low, high = sorted((side / 2 + (-0.05 - side / 2) * 5 / 2.6, side / 2 + (0.05 - side / 2) * 5 / 2.6))
        assert not ((y > low + 0.02) & (y < high - 0.02)).any()
    assert ((y > 1.0) & (y < 1.5)).sum() > 500


def test_bare_patches_have_no_points_and_their_share_is_as_asked():
    target = target_of(wall(5.0))
    every = features_of(target, CameraOptions(bare_share=0.0, features_per_m2=60.0), 3)
    most = features_of(target, CameraOptions(bare_share=0.6, features_per_m2=60.0, patch_m=0.6), 3)
    assert len(most.point) == pytest.approx(0.4 * len(every.point), rel=0.01)
    assert len(features_of(target, CameraOptions(bare_share=1.0), 3).point) == 0
    from scipy.spatial import cKDTree

    kept = np.isin(every.point[:, 1], most.point[:, 1])
    _, near = cKDTree(every.point).query(every.point, 2)
    assert (kept[near[:, 1]] == kept).mean() > 0.8  # by chance it were 0.52


def test_wrong_matches_have_their_share_and_no_object():
    options = StereoOptions(mismatch_share=0.2, features_per_m2=200.0, **HERE)
    (scan,) = scan_stereo(wall(5.0), options, 1)
    wrong = scan.cloud.label == -1
    assert stats.binomtest(int(wrong.sum()), len(wrong), 0.2).pvalue > 0.01
    assert np.abs(scan.cloud.points[wrong, 0] - 5).mean() > 1


def test_one_picture_is_not_enough():
    with pytest.raises(InputError, match="two pictures or more"):
        scan_photogrammetry(wall(5.0), PhotogrammetryOptions(**HERE))
    with pytest.raises(InputError, match="lower it"):
        scan_photogrammetry(wall(5.0), PhotogrammetryOptions(positions_m=((0, 0, 0), (0, 1, 0)), features_per_m2=1e6))


def test_structure_from_motion_is_told_in_its_own_frame_and_scale(tmp_path):
    """The files know no metres and no world; truth.json tells how to come back, and then they are the photogrammetric scan."""
    text = """
[[object]]
name = "block"
kind = "box"
x = 1
y = 1
z = 1
position = [4, -0.5, 0]
[[sensor]]
kind = "KIND"
positions_m = [[0, -0.7, 0.3], [0.5, 0.9, 1.4], [0.2, 2, 0.5]]
orientations_deg = [[3, 2, 8], [0, 5, -15], [0, 0, -30]]
features_per_m2 = 300
"""
    told = {}
    for kind in ("photogrammetry", "sfm"):
        given = scene_of(text.replace("KIND", kind))
        told[kind] = simulate_scene(given, tmp_path / kind, seed=4, formats=("ply", "xyz"), step=False).truth
    assert told["photogrammetry"]["unit"] == "m" and told["sfm"]["unit"] is None
    assert list(told["sfm"]["frames"]) == ["sfm_00.ply", "sfm_00.xyz"]
    T, scale = (told["sfm"]["frames"]["sfm_00.ply"][k] for k in ("T_world_scan", "lengths_per_m"))
    assert scale == pytest.approx(1 / np.linalg.norm([0.5, 1.6, 1.1]), rel=1e-12)  # the first two cameras are 1 apart
    world = read_scan(tmp_path / "photogrammetry" / "photogrammetry_00.ply", InputOptions()).scan
    own = read_scan(tmp_path / "sfm" / "sfm_00.ply", InputOptions()).scan
    assert len(world.cloud) > 100
    back = applied(np.array(T), own.cloud.points / scale)
    np.testing.assert_allclose(back, world.cloud.points, atol=1e-6)
    np.testing.assert_allclose(applied(np.array(T), own.sensors() / scale), world.sensors(), atol=1e-6)
    np.testing.assert_allclose(np.array(T)[:3, 3], [0, -0.7, 0.3], atol=1e-12)  # its origin is the first camera
    assert b"comment scan2fea, scale unknown" in (tmp_path / "sfm" / "sfm_00.ply").read_bytes()[:200]
    (scan,) = scan_photogrammetry(given.scene, given.sensors[0].options, 4)
    small = in_frame(scan, np.array(T), scale)
    np.testing.assert_allclose(small.cloud.sigma_along_m, scale * scan.cloud.sigma_along_m)
    np.testing.assert_allclose(small.rays.origin + small.rays.range_m[:, None] * small.rays.direction, small.cloud.points, atol=1e-9)
    assert told["sfm"]["objects"][0]["n_points"] == told["photogrammetry"]["objects"][0]["n_points"]


def test_a_scale_can_be_given_and_two_cameras_in_one_place_give_none():
    both = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    with pytest.raises(InputError, match="sensor sfm: positions_m: the first two cameras stand in one place"):
        sfm_frame(SfmOptions(positions_m=both))
    assert sfm_frame(SfmOptions(positions_m=both, scale=3.7))[1] == 3.7
