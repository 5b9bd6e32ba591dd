"""The plan: shares by brute force, bounds that simulated fits reach."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from scan2fea.cli.main import main
from scan2fea.errors import InputError
from scan2fea.kernel.transforms import rigid
from scan2fea.pipeline.plan import plan_scene
from scan2fea.simulation.bounds import bounds_from_points, edge_information, length_bound, member_bounds, observable
from scan2fea.simulation.sampling import SamplingOptions, sampled_solid
from scan2fea.simulation.scene_file import read_scene, scene_of
from scan2fea.simulation.shape_kinds import KINDS
from scan2fea.simulation.shapes import posed
from scan2fea.simulation.solids import Solid

PICTURED = """
[[object]]
name = "bar"
kind = "rect"
b = "100 mm"
t = "80 mm"
length = 1
[[sensor]]
kind = "%s"
positions_m = [[-1.5, 0.3, 0.2], [-1.4, -0.2, 0.8], [-1.5, 0.1, 1.2]]
"""


@pytest.mark.parametrize("kind", ["photogrammetry", "stereo"])
def test_a_sensor_without_a_law_of_ranges_is_as_noisy_as_its_points_say(tmp_path, kind):
    """No bound of a dimension is below the noise over the root of all points: pictures and sound were once planned as if they were exact."""
    path = tmp_path / "scene.toml"
    path.write_text(PICTURED % kind)
    (bar,) = plan_scene(read_scene(path)).objects
    assert bar.n_points > 0 and bar.sigma_m > 1e-4
    for row in bar.dimensions:
        assert row.std_m is None or row.std_m > 0.5 * bar.sigma_m / math.sqrt(bar.n_points)


SCENE = """
[[object]]
name = "box"
kind = "box"
x = 1
y = 1
z = 1
[[object]]
name = "bar"
kind = "rect"
b = "100 mm"
t = "80 mm"
length = 1
position = [3, 0, 0]
[[sensor]]
kind = "terrestrial"
positions_m = %s
step_deg = 0.5
noise_m = "1 mm"
"""


def test_a_box_shows_one_face_or_three():
    plan = plan_scene(scene_of(SCENE % "[[0.5, -3, 0.5], [-3, -3, 4]]"))
    box = plan.objects[0]
    assert box.stations[0].seen_share == pytest.approx(1 / 6, abs=0.025)  # 2000 samples: three standard deviations
    assert box.stations[1].seen_share == pytest.approx(3 / 6, abs=0.034)
    assert box.seen_share == pytest.approx(3 / 6, abs=0.034)
    assert box.n_points == sum(s.n_points for s in box.stations)


def test_the_spacing_of_a_face_seen_squarely():
    """At 3 m a step of 0.5 degrees is 26 mm; farther off the axis cells shrink as cos^3 of the angle to the normal and grow as 1 / cos(elevation)."""
    plan = plan_scene(scene_of(SCENE % "[[0.5, -3, 0.5]]"))
    step = 3 * math.radians(0.5)
    assert plan.objects[0].spacing_m == pytest.approx(step, rel=0.06)


def test_what_is_hidden_is_not_observable():
    one_side = plan_scene(scene_of(SCENE % "[[3.02, -4, 0.5]]"))
    bar = {d.name: d for d in one_side.objects[1].dimensions}
    assert bar["b"].observable  # its ends are in sight
    assert not bar["t"].observable and bar["t"].std_m is None
    all_round = plan_scene(scene_of(SCENE % "[[3, -4, 0.5], [3, 4, 0.5], [6, 0.1, 0.5], [1.5, 0.1, 3]]"))
    assert all(d.observable and d.std_m < 0.005 for d in all_round.objects[1].dimensions)


def test_more_noise_is_worse_and_more_points_are_better():
    values = {"a": 0.16, "b": 0.1, "t": 0.012, "length": 2.0}
    base = member_bounds("L", values, 0.002, 20_000)
    noisy, dense = member_bounds("L", values, 0.004, 20_000), member_bounds("L", values, 0.002, 80_000)
    for name in values:
        assert noisy[name] > base[name]
        assert dense[name] == pytest.approx(base[name] / 2, rel=1e-9)
    assert observable({"t": 0.003}, {"t": 0.012})["t"] is False  # on the threshold: a quarter is not below a quarter
    assert observable({"t": 0.00299}, {"t": 0.012})["t"] is True
    assert observable({"t": 0.001, "a": 0.001}, {"t": 0.012, "a": 0.012}, 0.006) == {"t": False, "a": True}  # a wall of two sigma is not above it
    assert observable({"t": 0.001}, {"t": 0.012}, 0.00599)["t"] is True


def test_published_bounds():
    """shape-estimation: an edge carries 0.903 rho / sigma; thin L of the thesis, 20,000 points, sigma 6.7 and 20 mm; length 0.66 mm at 2 mm."""
    assert edge_information() == pytest.approx(0.903, abs=5e-4)
    beam = {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}
    low, high = member_bounds("L", beam, 0.0067, 20_000), member_bounds("L", beam, 0.020, 20_000)
    assert (low["a"], low["t"]) == (pytest.approx(0.35e-3, abs=5e-6), pytest.approx(0.41e-3, abs=6e-6))
    assert (high["a"], high["t"]) == (pytest.approx(0.77e-3, abs=5e-6), pytest.approx(2.42e-3, abs=6e-6))
    caps = 20_000 * 1572.58e-6 / (0.508 * 3.048)
    assert length_bound(3.048, 0.002, 20_000, caps) == pytest.approx(0.66e-3, abs=6e-6)


def test_fifty_simulated_fits_scatter_as_planned():
    """A square bar, every face seen: least squares of b, t, place and roll with each point on its own face. 50 scans: the scatter is known to 10 %.

    The planned bound also counts what the blurred ends of the faces tell, a few per cent here: 20 % holds both.
    """
    values = {"b": 0.1, "t": 0.08, "length": 0.5}
    shape = KINDS["rect"].build(values, 1e-4)
    bar = Solid(name="bar", shape=shape, T_world_shape=rigid(np.eye(3), [0, 0, 0]), mesh=posed(shape.mesh, np.eye(4)), volume_m3=1.0)
    sigma, fits = 0.001, []
    for seed in range(50):
        exact, _ = sampled_solid(bar, SamplingOptions(spacing_m=0.01), seed)
        exact = exact[(exact[:, 2] > 1e-6) & (exact[:, 2] < 0.5 - 1e-6)]
        noisy = exact + sigma * np.random.default_rng([seed, 1]).standard_normal(exact.shape)
        rows, right = [], []
        for axis, half in ((0, 0.05), (1, 0.04)):
            for sign in (-1, 1):
                on = np.abs(exact[:, axis] - sign * half) < 1e-9
                p = noisy[on]
                other = p[:, 1 - axis] * (1 if axis == 1 else -1)  # a small roll moves x by -y, y by +x
                size = np.zeros((len(p), 2))
                size[:, axis] = sign / 2
                place = np.zeros((len(p), 2))
                place[:, axis] = 1
                rows.append(np.column_stack([size, place, other]))
                right.append(p[:, axis])
        fits.append(np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0][:2])
    exact, _ = sampled_solid(bar, SamplingOptions(spacing_m=0.01), 0)
    planned = bounds_from_points("rect", values, exact, sigma)
    scatter = np.std(fits, axis=0, ddof=1)
    assert scatter[0] == pytest.approx(planned["b"], rel=0.2)
    assert scatter[1] == pytest.approx(planned["t"], rel=0.2)
    np.testing.assert_allclose(np.mean(fits, axis=0), [0.1, 0.08], atol=4 * scatter.max() / 50**0.5)


def test_a_scene_without_sensor_cannot_be_planned():
    with pytest.raises(InputError, match="no sensor"):
        plan_scene(scene_of(SCENE.split("[[sensor]]")[0] + "[sampling]\n"))


def test_the_command_line(tmp_path, capsys):
    scene = tmp_path / "s.toml"
    scene.write_text(SCENE % "[[3.02, -4, 0.5]]")
    assert main(["plan", str(scene), "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    assert [o["name"] for o in tree["objects"]] == ["box", "bar"]
    assert main(["plan", str(scene)]) == 0
    told = capsys.readouterr().out
    assert "bar (rect)" in told and "t = 80 mm: NOT observable" in told


def test_noise_along_the_rays_is_felt_along_them_alone():
    """Rays at 60 degrees to x in the plane of the section: a width along x feels half the noise, one along y 0.87 of it; walls by their normals."""
    values = {"a": 0.16, "b": 0.1, "t": 0.012, "length": 2.0}
    shape = KINDS["L"].build(values, 1e-4)
    bar = Solid(name="L", shape=shape, T_world_shape=rigid(np.eye(3), [0, 0, 0]), mesh=posed(shape.mesh, np.eye(4)), volume_m3=1.0)
    points, _ = sampled_solid(bar, SamplingOptions(spacing_m=0.005), 0)
    rays = np.tile([0.5, 3**0.5 / 2, 0.0], (len(points), 1))
    told = bounds_from_points("L", values, points, 0.002, along=rays)
    for name, share in (("a", 0.5), ("b", 3**0.5 / 2)):
        assert told[name] == pytest.approx(bounds_from_points("L", values, points, 0.002 * share)[name], rel=1e-9)
    along_y = 0.16 / 0.26  # share of the sides whose normal is y: leg a's two faces and leg b's toe against the rest, to the wall's thickness
    felt = math.sqrt(along_y * 0.75 + (1 - along_y) * 0.25)
    assert told["t"] == pytest.approx(bounds_from_points("L", values, points, 0.002 * felt)["t"], rel=0.02)
    assert told["length"] < 0.5 * bounds_from_points("L", values, points, 0.002)["length"]


def test_a_face_that_rays_run_into_feels_all_their_noise():
    """A bar lit square to each of its faces: the mean over all faces would be 0.7 of the noise, but each width is told by the two faces across it."""
    values = {"b": 0.1, "t": 0.03, "length": 1.0}
    shape = KINDS["rect"].build(values, 1e-4)
    bar = Solid(name="bar", shape=shape, T_world_shape=rigid(np.eye(3), [0, 0, 0]), mesh=posed(shape.mesh, np.eye(4)), volume_m3=1.0)
    points, _ = sampled_solid(bar, SamplingOptions(spacing_m=0.005), 0)
    on_x = np.abs(np.abs(points[:, 0]) - 0.05) < 1e-9
    rays = np.where(on_x[:, None], -np.sign(points) * [1.0, 0, 0], -np.sign(points) * [0, 1.0, 0])
    square, even = bounds_from_points("rect", values, points, 0.002, along=rays), bounds_from_points("rect", values, points, 0.002)
    for name in ("b", "t"):
        assert square[name] == pytest.approx(even[name], rel=1e-9)
    one_side = points[~on_x]  # the two narrow faces unseen: b by the ends of the wide faces alone, along which these rays do not run
    told = bounds_from_points("rect", values, one_side, 0.002, along=rays[~on_x])
    assert told["b"] < 0.5 * bounds_from_points("rect", values, one_side, 0.002)["b"]
