import json

import numpy as np

from scan2fea.cli.main import main
from scan2fea.io.scan_writers import SCAN_WRITERS
from scan2fea.kernel.transforms import inverse, random_rotation, rigid
from workpiece import seen_from

POSE = rigid(random_rotation(1), [4.0, -7.0, 2.0])


def files(folder):
    folder.mkdir()
    scans = [seen_from((8, -4, 3), 12_000, 1, 0.003), seen_from((9, 1, 4), 12_000, 2, 0.003, T=inverse(POSE))]
    paths = [folder / "a.ply", folder / "empty.xyz", folder / "b.ply"]
    paths[1].write_text("")
    for path, scan in zip([paths[0], paths[2]], scans, strict=True):
        SCAN_WRITERS["ply"](path, scan)
    return [str(path) for path in paths]


def test_register_writes_cloud_trajectory_and_report(tmp_path, capsys):
    paths = files(tmp_path / "in")
    outs = [tmp_path / "one", tmp_path / "two"]
    for out in outs:
        assert main(["register", *paths, "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "2 of 3 inputs placed" in said and "empty.xyz" in said
    report = json.loads((outs[0] / "report.json").read_text())
    frames = report["registration"]["frames"]
    assert [frame["placed"] for frame in frames] == [True, False, True]
    assert "empty" in frames[1]["reason"]
    np.testing.assert_allclose(frames[2]["T_world_frame"], POSE, atol=0.02)
    assert 0 < frames[2]["std_m"] < 0.003 and 0 < frames[2]["std_rad"] < 0.01
    assert report["registration"]["mode"] == "auto"
    assert report["registration"]["links"][0]["used"]
    rows = np.loadtxt(outs[0] / "trajectory.txt")
    assert rows[:, 0].tolist() == [0, 1, 2]
    assert np.isnan(rows[1, 1:]).all()
    np.testing.assert_allclose(rows[2, 1:4], POSE[:3, 3], atol=0.02)
    for name in ("cloud.ply", "trajectory.txt", "report.json", "config.toml"):
        assert (outs[0] / name).read_bytes() == (outs[1] / name).read_bytes()


def test_register_refuses_a_folder_of_others_and_poses_of_others(tmp_path, capsys):
    paths = files(tmp_path / "in")
    assert main(["register", *paths, "-o", str(tmp_path / "in")]) == 2
    assert "holds other files" in capsys.readouterr().err
    (tmp_path / "poses.conf").write_text("bmesh nothing.ply 0 0 0 0 0 0 1\n")
    assert main(["register", *paths, "--poses", str(tmp_path / "poses.conf"), "-o", str(tmp_path / "out")]) == 3
    assert "names none of the inputs" in capsys.readouterr().err
