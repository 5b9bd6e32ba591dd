import numpy as np
import pytest

from scan2fea.kernel.transforms import inverse, random_rotation, rigid, rotation_about
from scan2fea.registration import RegistrationOptions, place
from scan2fea.types import PointCloud, Scan
from workpiece import errors, seen_from

STATIONS = [(8, -4, 3), (9, 1, 4), (7, 5, 3.5)]
SIGMA = 0.003
NAMES = ["a", "b", "c"]
AUTO, FREE = RegistrationOptions(), RegistrationOptions(mode="free")
CHECKED = RegistrationOptions(correct=True)
POSES = RegistrationOptions(poses="poses.txt")
CHECKED_POSES = RegistrationOptions(poses="poses.txt", correct=True)
GIVEN = [True, True, True]


def scans_of(poses=(None, None, None), known=True, n=14_000):
    return [seen_from(s, n, 10 + k, SIGMA, known, T) for k, (s, T) in enumerate(zip(STATIONS, poses, strict=True))]


def moved(shift, degrees=0.0):
    """A motion about the middle of the workpiece."""
    R, centre = rotation_about([0, 1.0, 0.3], np.radians(degrees)), np.array([2.0, 1.5, 0.5])
    return rigid(R, centre - R @ centre + np.array(shift))


def test_inputs_that_agree_stay_to_the_last_bit():
    scans = scans_of()
    for given in ((), GIVEN):
        placed = place(scans, [None] * 3, NAMES, CHECKED, is_placed=given)
        np.testing.assert_array_equal(placed.trajectory.T_world_frame, np.tile(np.eye(4), (3, 1, 1)))
        np.testing.assert_array_equal(placed.scan.cloud.points, np.concatenate([s.cloud.points for s in scans]))
        assert placed.notes == () and placed.reasons == ("", "", "")
        assert (placed.std_m < SIGMA).all()
        assert all(link.how == "check" for link in placed.links) and any(link.used for link in placed.links)


def test_given_poses_are_kept_and_the_others_found():
    G = rigid(random_rotation(1), [4.0, -7.0, 2.0])
    scans = scans_of((None, None, inverse(G)))
    placed = place(scans, [np.eye(4), np.eye(4), None], NAMES, POSES)
    np.testing.assert_array_equal(placed.trajectory.T_world_frame[:2], np.tile(np.eye(4), (2, 1, 1)))
    turn, shift = errors(placed.trajectory.T_world_frame[2], G, scans[2].cloud.points)
    assert turn < np.radians(0.2) and shift < 2 * SIGMA
    sensors = placed.scan.sensors()[placed.scan.cloud.frame == 2]
    np.testing.assert_allclose(sensors, np.tile(STATIONS[2], (len(sensors), 1)), atol=0.05)  # rays went along


def test_a_pose_that_is_wrong_is_corrected_and_said():
    wrong = moved([0.08, -0.05, 0.02], 1.0)
    scans = scans_of()
    placed = place(scans, [np.eye(4), wrong, np.eye(4)], NAMES, CHECKED_POSES)
    assert any(note.startswith("b: its pose was corrected by") for note in placed.notes)
    turn, shift = errors(placed.trajectory.T_world_frame[1], np.eye(4), scans[1].cloud.points)
    assert turn < np.radians(0.1) and shift < SIGMA
    np.testing.assert_array_equal(placed.trajectory.T_world_frame[[0, 2]], np.tile(np.eye(4), (2, 1, 1)))


def test_a_pose_that_is_wrong_by_less_than_matters_stays():
    slight = moved([0.0005, 0, 0])
    placed = place(scans_of(), [np.eye(4), slight, np.eye(4)], NAMES, CHECKED_POSES)
    np.testing.assert_array_equal(placed.trajectory.T_world_frame[1], slight)
    assert placed.notes == ()


def test_a_pose_that_is_given_stays_unless_a_correction_is_asked_for():
    wrong = moved([0.08, -0.05, 0.02], 1.0)
    placed = place(scans_of(), [np.eye(4), wrong, np.eye(4)], NAMES, POSES)
    np.testing.assert_array_equal(placed.trajectory.T_world_frame, np.stack([np.eye(4), wrong, np.eye(4)]))
    assert placed.links == () and placed.notes == ()


def test_free_believes_no_pose():
    poses = [rigid(random_rotation(30 + k), [k, 2.0, -k]) for k in range(3)]
    scans = scans_of([inverse(T) for T in poses])
    placed = place(scans, [None] * 3, NAMES, FREE, is_placed=GIVEN)
    assert placed.trajectory.placed.all()
    for k in (1, 2):
        turn, shift = errors(placed.trajectory.T_world_frame[k], inverse(poses[0]) @ poses[k], scans[k].cloud.points)
        assert turn < np.radians(0.2) and shift < 2 * SIGMA
    assert placed.std_m[0] == 0.0 and (placed.std_m[1:] > 0).all()


def test_placed_moves_nothing_and_looks_at_nothing():
    scans = scans_of()
    wrong = moved([0.08, 0, 0], 1.0)
    placed = place(scans, [np.eye(4), wrong, np.eye(4)], NAMES, RegistrationOptions(mode="placed", poses="poses.txt"))
    np.testing.assert_array_equal(placed.trajectory.T_world_frame[1], wrong)
    assert placed.links == ()


def test_a_small_frame_stays_where_its_file_puts_it():
    scans = [*scans_of()[:2], Scan(cloud=PointCloud.of(np.random.default_rng(0).random((12, 3))))]
    for mode in (AUTO, FREE):
        placed = place(scans, [None] * 3, NAMES, mode)
        assert placed.trajectory.placed[2]
        np.testing.assert_array_equal(placed.trajectory.T_world_frame[2], np.eye(4))


def test_an_empty_frame_and_a_strange_one_are_left_out_with_their_reason():
    random = np.random.default_rng(0)
    ball = random.normal(size=(8000, 3))
    ball *= (1.0 + 0.2 * np.sin(5 * ball[:, :1])) / np.linalg.norm(ball, axis=1, keepdims=True)
    scans = [*scans_of()[:2], Scan(cloud=PointCloud.of(np.zeros((0, 3)))), Scan(cloud=PointCloud.of(ball + [2.0, 1.5, 0.5]))]
    placed = place(scans, [None] * 4, ["a", "b", "empty", "ball"], AUTO)
    assert placed.trajectory.placed.tolist() == [True, True, False, False]
    assert placed.reasons[2] == "it holds no point"
    assert "--poses" in placed.reasons[3]
    assert [note.split(":")[0] for note in placed.notes] == ["empty", "ball"]
    assert np.isnan(placed.trajectory.T_world_frame[2:]).all()
    assert set(placed.scan.cloud.frame.tolist()) == {0, 1}


def test_a_plane_on_a_plane_is_said_to_slide():
    random = np.random.default_rng(0)
    flat = [Scan(cloud=PointCloud.of(np.c_[random.random((4000, 2)), random.normal(0, 0.002, 4000)])) for _ in range(2)]
    placed = place(flat, [None, None], ["a", "b"], FREE)
    assert placed.trajectory.placed.tolist() == [True, False]
    assert "3 of 6 motions open" in placed.reasons[1]


def test_parts_that_lie_beside_each_other_stay():
    scans = [scans_of()[0], Scan(cloud=PointCloud.of(np.random.default_rng(1).random((5000, 3)) * [1, 1, 0.001] + [20.0, 0, 0]))]
    placed = place(scans, [None, None], ["a", "b"], AUTO)
    np.testing.assert_array_equal(placed.trajectory.T_world_frame, np.tile(np.eye(4), (2, 1, 1)))
    assert placed.notes[0].startswith("b: stays as it lies, beside the other inputs")


def test_free_believes_no_place_beside_the_others_either():
    scans = [scans_of()[0], Scan(cloud=PointCloud.of(np.random.default_rng(1).random((5000, 3)) * [1, 1, 0.001] + [20.0, 0, 0]))]
    assert place(scans, [None, None], ["a", "b"], FREE).trajectory.placed.tolist() == [True, False]


def test_an_input_with_faces_is_never_moved():
    G = rigid(random_rotation(1), [0.5, 0.2, 0.3])
    scans = scans_of((None, G, None))
    placed = place(scans, [None] * 3, NAMES, AUTO, is_fixed=[False, True, False])
    np.testing.assert_array_equal(placed.trajectory.T_world_frame[1], np.eye(4))


@pytest.mark.parametrize("seed", [0, 5])
def test_the_same_seed_gives_the_same_bytes(seed):
    poses = [rigid(random_rotation(30 + k), [k, 2.0, -k]) for k in range(3)]
    scans = scans_of([inverse(T) for T in poses], n=6000)
    options = RegistrationOptions(mode="free", seed=seed)
    first, again = (place(scans, [None] * 3, NAMES, options) for _ in range(2))
    assert first.trajectory.T_world_frame.tobytes() == again.trajectory.T_world_frame.tobytes()


def test_frames_in_the_sensors_own_coordinates_are_registered_however_close_they_lie():
    step = np.array([0.02, 0.03, 0.0])  # less than the rule of agreement lets pass
    scans = [seen_from(STATIONS[0] + k * step, 12_000, k, SIGMA, T=rigid(np.eye(3), -(np.array(STATIONS[0]) + k * step))) for k in range(2)]
    placed = place(scans, [None, None], ["a", "b"], AUTO)
    np.testing.assert_allclose(placed.trajectory.T_world_frame[1][:3, 3], step, atol=SIGMA)
