from pathlib import Path

import numpy as np
import pytest

import real_scans
from scan2fea.errors import FormatError, InputError
from scan2fea.kernel.transforms import matrix_to_quaternion, quaternion_to_matrix, random_rotation, rigid
from scan2fea.registration import read_poses, read_trajectory

POSES = [rigid(random_rotation(i), [i, 2.0, -0.5]) for i in range(3)]
NAMES = ["a/scan_000.ply", "scan_001.ply", "scan_002.ply"]
DATA = real_scans.DATA


def quaternion_line(T):
    return " ".join(repr(float(x)) for x in [*T[:3, 3], *matrix_to_quaternion(T[:3, :3])])


def as_bun(T):
    x, y, z, w = matrix_to_quaternion(T[:3, :3])
    return " ".join(repr(float(v)) for v in [*T[:3, 3], -x, -y, -z, w])


WRITERS = {
    "bun.conf": lambda p: "camera 0 0 0 0 0 0 1\n" + "\n".join(f"bmesh {Path(n).name} {as_bun(T)}" for n, T in zip(NAMES, p, strict=True)),
    "graph.txt": lambda p: "\n".join(f"v{i} {quaternion_line(T)}" for i, T in reversed(list(enumerate(p)))),
    "graph_.txt": lambda p: "\n".join(f"v_{i} {quaternion_line(T)}" for i, T in enumerate(p)),
    "tum.txt": lambda p: "# time x y z\n\n" + "\n".join(f"{i * 0.1} {quaternion_line(T)}" for i, T in enumerate(p)),
    "kitti.txt": lambda p: "\n".join(" ".join(map(repr, T[:3].ravel().tolist())) for T in p),
    "matrices.txt": lambda p: "\n".join(" ".join(map(repr, row)) for T in p for row in T.tolist()),
    "rows.txt": lambda p: "\n".join(" ".join(map(repr, T.ravel().tolist())) for T in p),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_reads_back(tmp_path, kind):
    path = tmp_path / kind
    path.write_text(WRITERS[kind](POSES))
    for read, true in zip(read_poses(path, NAMES), POSES, strict=True):
        np.testing.assert_allclose(read, true, atol=1e-12)


def test_npy(tmp_path):
    np.save(tmp_path / "p.npy", np.array(POSES)[:, :3])
    np.testing.assert_allclose(read_poses(tmp_path / "p.npy", NAMES), POSES)
    np.save(tmp_path / "one.npy", POSES[1])
    np.testing.assert_allclose(read_poses(tmp_path / "one.npy", ["x.ply"])[0], POSES[1])


def test_names_and_numbers_that_are_missing(tmp_path):
    path = tmp_path / "bun.conf"
    path.write_text(f"bmesh scan_001.ply {as_bun(POSES[1])}\n")
    found = read_poses(path, NAMES)
    assert found[0] is None
    assert found[2] is None
    np.testing.assert_allclose(found[1], POSES[1], atol=1e-12)
    with pytest.raises(InputError, match=r"names none of the inputs; it has scan_001\.ply"):
        read_poses(path, ["other.ply"])
    path = tmp_path / "graph.txt"
    path.write_text(f"v7 {quaternion_line(POSES[0])}\n")
    with pytest.raises(InputError, match="numbers none"):
        read_poses(path, NAMES)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "rows of"),
        ("1 2 3\n", "rows of"),
        ("1 2 3 4\n1 2 3 4\n", "4 x 4"),
        ("0 0 0 0 0 0 0 0\n" * 3, "line 1: the quaternion is zero"),
        ("0 0 0 0 0 0 0 one\n" * 3, "line 1"),
        ("0 nan 0 0 0 0 0 1\n" * 3, "not finite"),
        ("bmesh scan_001.ply 1 2 3\n", "line 1: a pose is"),
        ("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "no rigid motion"),
    ],
)
def test_bad_files_say_which_line(tmp_path, text, says):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(FormatError, match=says) as told:
        read_poses(path, NAMES)
    assert str(path) in str(told.value)


def test_wrong_number_of_poses_and_missing_files(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(WRITERS["tum.txt"](POSES))
    with pytest.raises(InputError, match="3 poses for 2 inputs"):
        read_poses(path, NAMES[:2])
    with pytest.raises(InputError, match="no such file"):
        read_poses(tmp_path / "none.txt", NAMES)
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY\x01\x00garbage")
    with pytest.raises(FormatError, match=r"bad\.npy"):
        read_poses(tmp_path / "bad.npy", NAMES)
    (tmp_path / "bin.txt").write_bytes(bytes(range(256)))
    with pytest.raises(FormatError, match="is no text"):
        read_poses(tmp_path / "bin.txt", NAMES)


@real_scans.needs("registration", "stanford_bunny")
def test_the_convention_of_bun_conf_as_noted():
    """x_world = R(conj(q)) x + t, see NOTES.md of the data."""
    T = read_poses(DATA / "registration/stanford_bunny/bun.conf", ["bun045.ply"])[0]
    q = np.array([0.00548449, -0.294635, -0.0038555, 0.955586])
    np.testing.assert_allclose(T[:3, :3], quaternion_to_matrix(q * [-1, -1, -1, 1]), atol=1e-6)
    np.testing.assert_allclose(T[:3, 3], [-0.0520211, -0.000383981, -0.0109223])


# ---- KITTI: poses of a camera, rows numbered by frame

T_CAMERA = rigid(quaternion_to_matrix([0.5, -0.5, 0.5, 0.5]), [0.01, -0.07, -0.27])


def kitti(tmp_path, poses, head="P0: 1 0 0 0 0 1 0 0 0 0 1 0\n"):
    (tmp_path / "poses.txt").write_text(WRITERS["kitti.txt"](poses))
    (tmp_path / "calib.txt").write_text(head + "Tr: " + " ".join(map(repr, T_CAMERA[:3].ravel().tolist())) + "\n")
    return tmp_path / "poses.txt", tmp_path / "calib.txt"


def test_poses_of_a_camera_become_poses_of_the_scans(tmp_path):
    path, calibration = kitti(tmp_path, POSES)
    point = np.array([3.0, -2.0, 0.4, 1.0])
    for T, found in zip(POSES, read_poses(path, NAMES, calibration), strict=True):
        in_camera_0 = T @ T_CAMERA @ point
        np.testing.assert_allclose(T_CAMERA @ found @ point, in_camera_0, atol=1e-12)  # the same point, seen from camera 0


def test_rows_of_a_sequence_are_taken_by_the_number_of_the_frame(tmp_path):
    path, _ = kitti(tmp_path, POSES)
    found = read_poses(path, ["velodyne/000002.bin", "velodyne/000000.bin"])
    np.testing.assert_allclose(found, [POSES[2], POSES[0]], atol=1e-12)
    with pytest.raises(InputError, match=r"holds 3 poses, none for 000003\.bin: it is of other frames"):
        read_poses(path, ["000003.bin"])
    with pytest.raises(InputError, match="holds 3 poses for 2 inputs"):
        read_poses(path, ["a.bin", "b.bin"])


@pytest.mark.parametrize("text, said", [
    ("P0: 1 2 3\n", "has no line Tr:"), ("Tr: 1 2 3\n", "Tr has 3 numbers, 12 are needed"), ("Tr: 1 0 0 0 0 1 0 0 0 0 2 0\n", "no rigid motion"),
    ("Tr: a 0 0 0 0 1 0 0 0 0 2 0\n", "line 1: could not convert"),
])  # fmt: skip
def test_what_is_wrong_with_a_calibration(text, said, tmp_path):
    path, calibration = kitti(tmp_path, POSES)
    calibration.write_text(text)
    with pytest.raises(FormatError, match=said):
        read_poses(path, NAMES, calibration)
    with pytest.raises(InputError, match="no such file of calibration"):
        read_poses(path, NAMES, tmp_path / "none.txt")


def test_times_that_do_not_rise_are_named_by_their_line(tmp_path):
    path = tmp_path / "way.txt"
    path.write_text("# t x y z q\n1.0 0 0 0 0 0 0 1\n1.2 1 0 0 0 0 0 1\n1.1 2 0 0 0 0 0 1\n")
    with pytest.raises(FormatError, match=r"line 4: its time 1.1 s is not after the 1.2 s before it: sort the poses by time"):
        read_trajectory(path)
    path.write_text("1.0 0 0 0 0 0 0 1\n1.2 1 0 0 0 0 0 1\n")
    assert read_trajectory(path).time_s.tolist() == [1.0, 1.2]
    path.write_text("bmesh a.ply 0 0 0 0 0 0 1\n")
    assert read_trajectory(path) is None
