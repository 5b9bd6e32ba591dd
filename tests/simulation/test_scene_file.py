"""Scene files: what they say is built; what is wrong is refused in one line that names the object and the key."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.kernel.measures import volume
from scan2fea.simulation.scene_checks import check_scene, check_sensor
from scan2fea.simulation.scene_file import read_scene, scene_of
from scan2fea.simulation.scene_values import length_of

GOOD = """
name = "yard"

[[object]]
name = "floor"
kind = "box"
x = "4 m"
y = 3
z = "100 mm"
position = [0, 0, "-100 mm"]
reflectance = 0.2

[[object]]
name = "beam"
kind = "I"
h = "200 mm"
b = "10 cm"
tw = "6 mm"
tf = "9 mm"
length = "2 m"
position = ["1 m", 1, 0.0]
rotation_deg = [0, 0, 0]
spacing = "5 mm"
defects = [{ kind = "sag", depth = "5 mm", direction = "+x" }]

[[sensor]]
kind = "stations"
positions_m = [[0, 0, 1], ["3 m", "100 cm", 2]]
noise_m = "2 mm"

[sampling]
method = "blue_noise"
"""


def test_a_good_scene():
    given = scene_of(GOOD)
    scene = given.scene
    assert (scene.name, [s.name for s in scene.solids]) == ("yard", ["floor", "beam"])
    floor, beam = scene.solids
    assert volume(floor.mesh) == pytest.approx(1.2)
    assert floor.mesh.vertices[:, 2].max() == 0
    assert floor.reflectance == 0.2
    assert beam.spacing_m == 0.005
    assert beam.shape.parameters["b"] == pytest.approx(0.1)
    assert beam.volume_m3 == pytest.approx(2 * (2 * 0.1 * 0.009 + 0.182 * 0.006))
    assert beam.defects == (("sag", {"depth": 0.005, "direction": "+x"}),)
    assert given.sensors[0].options.positions_m == ((0.0, 0.0, 1.0), (3.0, 1.0, 2.0))
    assert given.sensors[0].options.noise_m == pytest.approx(0.002)
    assert given.sampling.method == "blue_noise"
    check_scene(scene)  # the beam stands on the floor: touching is no overlap


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('x = "4 m"', "x = -4", "object floor: x is -4 m; it must be positive"),
        ('x = "4 m"', "x = 0", "object floor: x is 0 m; it must be positive"),
        ('x = "4 m"\n', "", "object floor: x is missing"),
        ('kind = "box"', 'kind = "bx"', "object floor: kind 'bx' is unknown; did you mean box"),
        ('z = "100 mm"', 'z = "100 mn"', "object floor: z is '100 mn': unit 'mn' is not known"),
        ('z = "100 mm"', "z = true", "object floor: z is True: write metres"),
        ('z = "100 mm"', "z = nan", "object floor: z is nan: it must be a finite length"),
        ('tw = "6 mm"', 'tww = "6 mm"', "object beam: tww is not known; did you mean tw?"),
        ('tw = "6 mm"', 'tw = "100 mm"', "object beam: section I: tw is 0.1 m; it must be less than 0.1 m"),
        ('tf = "9 mm"', 'tf = "100 mm"', "object beam: section I: tf is 0.1 m"),
        ('tw = "6 mm"', 'tw = "-6 mm"', "object beam: tw is -0.006 m; it must be positive"),
        ('name = "beam"', 'name = "floor"', "object floor: name is given to 2 objects"),
        ('name = "beam"', 'name = "a/b"', "name 'a/b' must be letters"),
        ("rotation_deg = [0, 0, 0]", "rotation_deg = [0, 0]", "object beam: rotation_deg is .0, 0.: it must be a list of three"),
        ('spacing = "5 mm"', "spacing = 0", "object beam: spacing is 0.0 m; it must be positive"),
        ("reflectance = 0.2", "reflectance = 1.2", "object floor: reflectance is 1.2; it must lie between 0 and 1"),
        ('depth = "5 mm"', 'depht = "5 mm"', "object beam: defect sag: depht is not known; did you mean depth?"),
        ('"+x" }', '"+z" }', "object beam: defect sag: direction is '.z': use"),
        ('kind = "sag"', 'kind = "sagg"', "object beam: defects: kind 'sagg' is unknown; did you mean sag?"),
        ('kind = "stations"', 'kind = "statons"', "sensor 1: kind 'statons' is unknown; did you mean stations?"),
        ("positions_m", "position_m", "sensor 1 .stations.: position_m is not known; did you mean positions_m?"),
        ('noise_m = "2 mm"', "noise_m = -1", "sensor 1 .stations.: noise_m is -1: its minimum is 0"),
        ('noise_m = "2 mm"', "noise_m = [1]", "sensor 1 .stations.: noise_m is .1.0.: it must be a number"),
        ('method = "blue_noise"', 'method = "blue"', "sampling: method is 'blue'; did you mean blue_noise.: use uniform"),
        ('[[0, 0, 1], ["3 m", "100 cm", 2]]', "[1, 2, 3]", "positions_m is .1.0, 2.0, 3.0.: it must be a list, each entry a list of 3 numbers"),
        ('[[0, 0, 1], ["3 m", "100 cm", 2]]', "[[1, 2]]", "positions_m is .*: it must be a list, each entry a list of 3 numbers"),
        ('[[0, 0, 1], ["3 m", "100 cm", 2]]', "[[0, 0, 1], [0, 0]]", "it must be a list, each entry a list of 3 numbers"),
        ('[[0, 0, 1], ["3 m", "100 cm", 2]]', "5", "positions_m is 5.0: it must be a list"),
        ('length = "2 m"', "length = 1e12", "object beam: length is 1e.12 m; it must lie between 1e-06 and 100000 m"),
        ('length = "2 m"', "length = 1e-12", "object beam: length is 1e-12 m; it must lie between"),
        ('position = ["1 m", 1, 0.0]', "position = [1e300, 1, 1]", "object beam: position is .*: it must lie within 1e.08 m"),
        ("[[object]]", "[[objects]]", "the scene: objects is not known; did you mean object?"),
        ("[sampling]", "[[", "is not TOML"),
    ],
)
def test_bad_scenes_name_object_and_key(old, new, says):
    with pytest.raises(InputError, match=says) as raised:
        scene_of(GOOD.replace(old, new))
    assert "\n" not in str(raised.value).strip() or "TOML" in str(raised.value)


def test_no_object_no_sensor():
    with pytest.raises(InputError, match="has no object"):
        scene_of("[sampling]")
    with pytest.raises(InputError, match="has no sensor"):
        scene_of(GOOD.split("[[sensor]]")[0])


def test_lengths():
    assert length_of("127 mm", "x") == pytest.approx(0.127)
    assert length_of("5 in", "x") == pytest.approx(0.127)
    assert length_of("-1e1 cm", "x") == pytest.approx(-0.1)
    assert length_of(2, "x") == 2.0
    for bad in ("5", "mm", "5 5 mm", "--3 m", "e m", "1e999 m", [1], None):
        with pytest.raises(InputError, match="x is"):
            length_of(bad, "x")


def test_a_file_that_is_missing_or_no_text(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: cannot be read"):
        read_scene(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"b\.toml: cannot be read"):
        read_scene(tmp_path / "b.toml")
    (tmp_path / "s.toml").write_text(GOOD.replace('x = "4 m"', "x = -4"))
    with pytest.raises(InputError, match=r"s\.toml: object floor: x is -4 m"):
        read_scene(tmp_path / "s.toml")


@pytest.mark.parametrize(("z", "depth"), [("-10 mm", "10 mm"), (-0.05, "50 mm"), ("-0.01 mm", "0.01 mm")])
def test_overlap_is_told_with_its_depth(z, depth):
    with pytest.raises(InputError, match=f"object beam: position: it overlaps object floor by {depth} or more"):
        check_scene(scene_of(GOOD.replace('["1 m", 1, 0.0]', f'["1 m", 1, "{z}"]' if isinstance(z, str) else f"[1, 1, {z}]")).scene)


def test_overlap_without_a_vertex_inside_and_one_wholly_inside():
    crossing = """
[[object]]
kind = "box"
name = "a"
x = 1
y = 0.1
z = 0.1
[[object]]
kind = "box"
name = "b"
x = 0.1
y = 1
z = 0.1
position = [0.5, -0.5, 0.01]
[sampling]
"""
    with pytest.raises(InputError, match="object b: position: it overlaps object a"):
        check_scene(scene_of(crossing).scene)
    inside = crossing.replace("y = 1\n", "y = 0.05\n").replace("-0.5, 0.01", "0.02, 0.02").replace("z = 0.1\nposition", "z = 0.05\nposition")
    with pytest.raises(InputError, match="overlaps"):
        check_scene(scene_of(inside).scene)
    check_scene(scene_of(crossing.replace("-0.5, 0.01", "-0.5, 0.1")).scene)  # one lies on the other
    check_scene(scene_of(crossing.replace("-0.5, 0.01", "0.1, 0.0")).scene)  # side by side


def test_a_sensor_inside_a_solid_is_refused_on_its_surface_it_is_not():
    scene = scene_of(GOOD).scene
    check_sensor(scene, np.array([[1.0, 1.0, 0.0], [3, 1, 1]]), "s")
    with pytest.raises(InputError, match=r"sensor s: positions_m: position 2 \(1, 1, -0.05\) lies inside object floor"):
        check_sensor(scene, np.array([[3.0, 1, 1], [1.0, 1.0, -0.05]]), "s")


def test_every_example_scene_is_sound():
    from pathlib import Path

    found = sorted((Path(__file__).parents[2] / "examples").glob("ex_scene*.toml"))
    assert found
    for path in found:
        given = read_scene(path)
        check_scene(given.scene)
        for sensor in given.sensors:
            check_sensor(given.scene, np.array(sensor.options.positions_m), sensor.kind)
