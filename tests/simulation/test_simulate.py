"""The whole command: files that read back, truth that agrees with them, whole or not at all, the same bytes."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from scan2fea.cli.main import main
from scan2fea.errors import InputError, UsageError
from scan2fea.io import InputOptions, read_mesh, read_scan
from scan2fea.kernel.distances import distance_to_mesh
from scan2fea.kernel.measures import area, volume
from scan2fea.pipeline.simulate import scene_named, simulate_scene, with_noise, with_sensor
from scan2fea.simulation.scene_file import scene_of

SCENE = """
name = "two"
[[object]]
name = "beam"
kind = "I"
h = "200 mm"
b = "100 mm"
tw = "6 mm"
tf = "9 mm"
fillet = "10 mm"
length = "1 m"
spacing = "20 mm"
[[object]]
name = "box"
kind = "box"
x = 0.3
y = 0.2
z = 0.1
position = [1, 0, 0]
spacing = "20 mm"
[[sensor]]
kind = "terrestrial"
positions_m = [[-1, -1, 0.5], [2, 1.5, 1.2]]
step_deg = 1.0
noise_m = "1 mm"
[[sensor]]
kind = "stations"
positions_m = [[0, -2, 0.5]]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("sim") / "two"
    return out, simulate_scene(scene_of(SCENE), out, seed=3, formats=("ply", "pcd", "ptx", "las", "xyz")[:2])


def everything(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_files_and_truth_agree(made):
    out, result = made
    truth = json.loads((out / "truth.json").read_text())
    assert truth == json.loads(json.dumps(result.truth))
    assert truth["files"] == [f"{stem}.{s}" for stem in ("terrestrial_00", "terrestrial_01", "stations_00") for s in ("ply", "pcd")]
    counts = np.zeros(2, int)
    for name in truth["files"]:
        raw = read_scan(out / name, InputOptions())
        points = raw.scan.cloud.points
        if name.endswith(".ply"):
            exact = [distance_to_mesh(points, read_mesh(out / o["mesh"])).distance for o in truth["objects"]]
            assert np.minimum(*exact).max() < 0.006  # 1 mm of noise along rays
            counts += np.array([int((exact[k] < exact[1 - k]).sum()) for k in (0, 1)])
            assert raw.scan.rays is not None
            sensors = raw.scan.sensors()
            assert np.isfinite(sensors).all()
    assert counts.sum() == truth["n_points"]
    np.testing.assert_allclose(counts, [o["n_points"] for o in truth["objects"]], atol=2)
    for thing in truth["objects"]:
        mesh = read_mesh(out / thing["mesh"])
        assert volume(mesh) == pytest.approx(thing["volume_m3"], rel=1e-12)
        assert area(mesh) == pytest.approx(thing["area_m2"], rel=1e-12)
        assert thing["exact"]["volume_m3"] == pytest.approx(thing["volume_m3"], rel=1e-2 if thing["chord_m"] else 1e-12)
        assert 0.2 < thing["seen_fraction"] < 1
        step = (out / thing["step"]).read_text()
        assert step.startswith("ISO-10303-21")
    assert truth["objects"][0]["params_m"] == {"h": 0.2, "b": 0.1, "tw": 0.006, "tf": 0.009, "length": 1.0, "fillet": 0.01}
    assert "CYLINDRICAL_SURFACE" in (out / truth["objects"][0]["step"]).read_text()


def test_ply_keeps_sensor_direction_time_ring_object_and_misses(made):
    raw = (made[0] / "terrestrial_00.ply").read_bytes()
    header = raw[: raw.index(b"end_header")].decode()
    for name in ("x", "sensor_x", "ray_x", "time", "ring", "object", "sigma_m"):
        assert f" {name}\n" in header, name
    scan = read_scan(made[0] / "terrestrial_00.ply", InputOptions()).scan
    assert np.isnan(scan.rays.range_m).sum() > 1000
    np.testing.assert_allclose(scan.sensors()[0], [-1, -1, 0.5])


def test_pcd_says_where_it_stood(made):
    head = (made[0] / "terrestrial_01.pcd").read_bytes()[:600].decode(errors="replace")
    assert "VIEWPOINT 2.0 1.5 1.2 1 0 0 0" in head
    np.testing.assert_allclose(read_scan(made[0] / "terrestrial_01.pcd", InputOptions()).scan.sensors()[0], [2, 1.5, 1.2])


def test_same_seed_same_bytes_another_seed_others(made, tmp_path):
    simulate_scene(scene_of(SCENE), tmp_path / "two", seed=3, formats=("ply", "pcd"))
    a, b = everything(made[0]), everything(tmp_path / "two")
    assert a == b
    simulate_scene(scene_of(SCENE), tmp_path / "other" / "two", seed=4, formats=("ply",))
    assert (tmp_path / "other" / "two" / "terrestrial_00.ply").read_bytes() != a["terrestrial_00.ply"]


def test_ptx_las_xyz_read_back(tmp_path):
    given = scene_of(SCENE.split('[[sensor]]\nkind = "stations"')[0])
    simulate_scene(given, tmp_path / "o", formats=("ply", "ptx", "las", "xyz"), step=False)
    ply = read_scan(tmp_path / "o" / "terrestrial_00.ply", InputOptions()).scan
    for suffix, tolerance in (("ptx", 2e-6), ("las", 1e-5), ("xyz", 1e-9)):
        other = read_scan(tmp_path / "o" / f"terrestrial_00.{suffix}", InputOptions()).scan
        np.testing.assert_allclose(other.cloud.points, ply.cloud.points, atol=tolerance)
    ptx = read_scan(tmp_path / "o" / "terrestrial_00.ptx", InputOptions()).scan
    assert np.isnan(ptx.rays.range_m).sum() == np.isnan(ply.rays.range_m).sum()
    np.testing.assert_allclose(ptx.sensors()[0], [-1, -1, 0.5])
    assert not list((tmp_path / "o" / "truth").glob("*.step"))


def test_ptx_of_what_is_no_grid_is_refused_and_nothing_is_left(tmp_path):
    given = scene_of(SCENE.replace("terrestrial", "stations").replace("step_deg = 1.0\n", ""))
    with pytest.raises(InputError, match="PTX holds the grid of one station"):
        simulate_scene(given, tmp_path / "o", formats=("ply", "ptx"))
    assert list(tmp_path.iterdir()) == []


def test_a_failed_scene_leaves_out_as_it_was(tmp_path):
    out = tmp_path / "o"
    simulate_scene(scene_of(SCENE), out, formats=("ply",), step=False)
    before = everything(out)
    bad = scene_of(SCENE.replace("position = [1, 0, 0]", "position = [0, 0, 0.5]"))
    with pytest.raises(InputError, match="object box: position: it overlaps object beam"):
        simulate_scene(bad, out)
    inside = scene_of(SCENE.replace("[0, -2, 0.5]", "[1.1, 0.1, 0.05]"))
    with pytest.raises(InputError, match=r"sensor stations: positions_m: position 1 .* lies inside object box"):
        simulate_scene(inside, out)
    blind = scene_of(
        SCENE.replace("[0, -2, 0.5]", "[0, -2000000, 0.5]").split("[[sensor]]")[0]
        + "[[sensor]]\nkind='terrestrial'\npositions_m=[[0,-500,0]]\nstep_deg=5"
    )
    with pytest.raises(InputError, match="nothing comes into its reach"):
        simulate_scene(blind, out)
    with pytest.raises(UsageError, match="--format stl"):
        simulate_scene(scene_of(SCENE), out, formats=("stl",))
    assert everything(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["o"]


def test_noise_and_sensor_from_outside():
    given = scene_of(SCENE)
    assert [s.options.noise_m for s in with_noise(given, 0.005).sensors] == [0.005, 0.005]
    assert [s.kind for s in with_sensor(given, "stations").sensors] == ["stations"]
    assert [s.kind for s in with_sensor(given, "HDL-32E").sensors] == ["hdl32e"]
    moved = with_sensor(given, "photogrammetry").sensors[0]
    assert moved.options.positions_m == given.sensors[0].options.positions_m
    with pytest.raises(UsageError, match="--sensor lasre: unknown"):
        with_sensor(given, "lasre")
    lab = scene_named("lab", 0)
    assert with_noise(lab, 0.02, "uniform").sampling.noise == "uniform"
    with pytest.raises(InputError, match="nowhere: no such scene"):
        scene_named("nowhere", 0)


def test_the_demo_is_scanned_as_the_demo_scans_it(tmp_path):
    """Same points as simulate_lab, of which `scan2fea demo` makes its files."""
    from scan2fea.pipeline.simulate import scanned
    from scan2fea.simulation import LabOptions, simulate_lab

    mine, demo = scanned(scene_named("demo", 0), 0), simulate_lab(LabOptions(seed=0)).scans
    assert len(mine) == len(demo)
    for (_, a), b in zip(mine, demo, strict=True):
        assert a.cloud.points.tobytes() == b.cloud.points.tobytes()


def test_the_command_line(tmp_path, capsys):
    scene = tmp_path / "s.toml"
    scene.write_text(SCENE)
    assert main(["simulate", str(scene), "-o", str(tmp_path / "o"), "--sensor", "stations", "--noise", "2 mm", "--no-step"]) == 0
    truth = json.loads((tmp_path / "o" / "truth.json").read_text())
    assert truth["sigma_m"] == pytest.approx(0.002)
    assert truth["sensors"] == ["stations"]
    assert (tmp_path / "o" / "scene.png").read_bytes().startswith(b"\x89PNG")
    scene.write_text(SCENE.replace('tw = "6 mm"', 'tw = "600 mm"'))
    capsys.readouterr()
    assert main(["simulate", str(scene), "-o", str(tmp_path / "p")]) == 3
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "object beam: section I: tw is 0.6 m" in told
    assert not (tmp_path / "p").exists()
    assert main(["simulate", str(scene), "-o", str(tmp_path / "p"), "--noise", "2 mn"]) in (2, 3)


def test_a_sampled_member_carries_its_bounds(tmp_path):
    text = SCENE.split("[[sensor]]")[0].replace('fillet = "10 mm"\n', "") + "[sampling]\nnoise_m = '2 mm'\nspacing_m='10 mm'\n"
    truth = simulate_scene(scene_of(text), tmp_path / "o", step=False).truth
    beam = truth["objects"][0]
    assert set(beam["crb_m"]) == {"h", "b", "tw", "tf", "length"}
    assert all(0 < v < 0.01 and math.isfinite(v) for v in beam["crb_m"].values())
    assert beam["seen_fraction"] == 1 and truth["coverage"] == "full"
    assert truth["spacing_m"] == pytest.approx(0.01, rel=0.02)


def test_a_moving_sensor_leaves_its_logs(tmp_path):
    text = SCENE.split("[[sensor]]")[0] + (
        "[[sensor]]\nkind = 'hdl32e'\npositions_m = [[-1, -1, 0.5], [1, -1, 0.5]]\ntimes_s = [0, 0.2]\n"
        "[[sensor]]\nkind = 'stations'\npositions_m = [[0, -2, 0.5]]\n"
    )
    out = simulate_scene(scene_of(text), tmp_path / "o", step=False)
    logs = out.truth["logs"]
    assert "logs/hdl32e.pcap" in logs and "logs/hdl32e_truth.txt" in logs and "logs/hdl32e_imu.csv" in logs
    assert not any("stations" in name for name in logs)
    for name in logs:
        assert (tmp_path / "o" / name).stat().st_size > 100
    first = [float(v) for v in (tmp_path / "o" / "logs" / "hdl32e_truth.txt").read_text().split()[:4]]
    assert first == [0.0, -1.0, -1.0, 0.5]
