import math

import numpy as np
import pytest

from scan2fea.errors import EstimationError, UsageError
from scan2fea.estimation.likelihood import Layout, model_of
from scan2fea.estimation.rays_of_member import first_crossing
from scan2fea.estimation.visible import FLAT, SEEN, flux_weights, likeliest_set, seen_shares, visible_sets
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.sections import PARAMETERS, section

SECTIONS = {
    "L": {"a": 0.127, "b": 0.1, "t": 0.01},
    "I": {"h": 0.22, "b": 0.11, "tw": 0.006, "tf": 0.0092},
    "C": {"h": 0.2, "b": 0.08, "tw": 0.006, "tf": 0.01},
    "T": {"h": 0.1, "b": 0.12, "tw": 0.008, "tf": 0.01},
    "RHS": {"h": 0.2, "b": 0.1, "t": 0.006},
    "rect": {"b": 0.1, "t": 0.02},
}


@pytest.mark.parametrize("family", SECTIONS)
def test_a_place_is_seen_where_the_first_crossing_of_its_ray_is_the_place_itself(family):
    values = SECTIONS[family]
    shape = section(family, values)
    outline = shape.loops[0]
    after = np.roll(np.arange(len(outline)), -1)
    rng = np.random.default_rng(3)
    turn = rng.uniform(0, 2 * np.pi, 12)
    sensors = 0.9 * np.stack([np.cos(turn), np.sin(turn)], 1)
    shares = seen_shares(family, values, sensors)
    for name, p, q in zip(shape.face_names[0], outline, outline[after], strict=True):
        normal = np.array([q[1] - p[1], p[0] - q[0]]) / np.linalg.norm(q - p)
        for row, sensor in enumerate(sensors):
            places = p + ((np.arange(500) + 0.5) / 500)[:, None] * (q - p)
            way = places - sensor
            distance = np.linalg.norm(way, axis=1)
            first = first_crossing(np.tile(sensor, (500, 1)), way / distance[:, None], outline, after)
            seen = (first > distance * (1 - 1e-9)) & (-(way @ normal) > FLAT * distance)
            assert abs(shares[row, faces(family).index(name)] - seen.mean()) <= 1 / 64 + 1 / 500, (name, sensor)


def test_an_angle_from_outside_and_from_inside():
    values = SECTIONS["L"]
    outside, inside = seen_shares("L", values, np.array([[-3.0, -3.0], [3.0, 3.0]]))
    told = dict(zip(faces("L"), zip(outside, inside, strict=True), strict=True))
    assert told["A_OUTER"] == told["B_OUTER"] == (1.0, 0.0)
    assert told["A_INNER"][0] == told["B_INNER"][0] == told["A_TOE"][0] == 0.0
    assert told["A_INNER"][1] == told["B_INNER"][1] == told["A_TOE"][1] == told["B_TOE"][1] == 1.0
    assert visible_sets("L", values, np.array([[-3.0, -3.0]])) == (("A_OUTER", "B_OUTER"),)


@pytest.mark.parametrize("family", [*SECTIONS, "CHS", "round"])
def test_sets_without_sensors(family):
    values = {**SECTIONS, "CHS": {"d": 0.1, "t": 0.005}, "round": {"d": 0.1}}[family]
    sets = visible_sets(family, values)
    outer = set(section(family, values).face_names[0])
    assert set(sets[0]) == outer  # from all around: everything but the inside of a tube
    assert len(set(sets)) == len(sets) < 2 ** len(outer)
    assert all(set(one) <= outer for one in sets)
    bigger = {name: 7.0 * v for name, v in values.items()}
    assert visible_sets(family, bigger) == sets


def test_sets_of_one_direction_are_among_them():
    sets = {frozenset(one) for one in visible_sets("I", SECTIONS["I"])}
    for k in range(72):  # the directions that are looked from
        a = 2 * math.pi * (k + 0.5) / 72
        share = seen_shares("I", SECTIONS["I"], 1e3 * np.array([[math.cos(a), math.sin(a)]]))[0]
        assert frozenset(n for n, s in zip(faces("I"), share, strict=True) if s >= SEEN) in sets
    assert frozenset(faces("I")) - {"BOTTOM_OUTER"} in sets
    assert frozenset(["TOP_OUTER", "BOTTOM_OUTER"]) not in sets  # nobody sees both outer sides and nothing between them


def test_flux_of_a_far_sensor_is_the_cosine():
    a = math.radians(30)
    weight = flux_weights("rect", SECTIONS["rect"], 1e4 * np.array([[math.sin(a), math.cos(a)]]))
    told = dict(zip(faces("rect"), weight, strict=True))
    assert told["TOP"] == 1.0 and told["BOTTOM"] == told["LEFT"] == 0.0
    assert told["RIGHT"] == pytest.approx(math.tan(a), rel=1e-4)


@pytest.mark.parametrize("hidden", [(), ("BOTTOM_OUTER",), ("BOTTOM_OUTER", "BOTTOM_INNER_LEFT", "WEB_LEFT", "TOP_INNER_LEFT", "BOTTOM_TOE_LEFT")])
def test_the_faces_that_points_lie_on_are_found(hidden):
    values = SECTIONS["I"]
    rng = np.random.default_rng(1)
    shape = section("I", values)
    loop = shape.loops[0]
    edges = [(p, q) for p, q, name in zip(loop, np.roll(loop, -1, 0), shape.face_names[0], strict=True) if name not in hidden]
    length = np.array([np.linalg.norm(q - p) for p, q in edges])
    pick = rng.choice(len(edges), 4000, p=length / length.sum())
    k = rng.random(4000)
    xy = np.array([edges[e][0] + s * (edges[e][1] - edges[e][0]) for e, s in zip(pick, k, strict=True)]) + 0.002 * rng.standard_normal((4000, 2))
    points = np.column_stack([xy, rng.uniform(0, 1.5, 4000)])
    layout = Layout(family="I")
    model = model_of(points, layout, (0.0, 1.5), area_m2=0.03, noise="gaussian", face_weight=None)
    theta = np.zeros(len(layout.names))
    theta[: layout.n_values] = [values[n] for n in PARAMETERS["I"]]
    theta[layout.place["log_sigma"]], theta[layout.place["logit_outliers"]] = math.log(0.002), -6.0
    found = likeliest_set(model, theta, visible_sets("I", values))
    wanted = set(faces("I")) - set(hidden)
    wide = {"BOTTOM_TOE_LEFT", "BOTTOM_TOE_RIGHT", "TOP_TOE_LEFT", "TOP_TOE_RIGHT"}  # 9 mm toes hold 1 % of the points each
    assert set(found.faces) - wide == wanted - wide
    assert found.weight.sum() == len(found.faces) and found.bic.argmin() == list(visible_sets("I", values)).index(found.faces)


def test_bad_input():
    with pytest.raises(EstimationError, match="lies inside the L"):
        seen_shares("L", SECTIONS["L"], np.array([[0.05, 0.005]]))
    seen_shares("RHS", SECTIONS["RHS"], np.array([[0.0, 0.0]]))  # in the bore of a tube
    with pytest.raises(UsageError, match="family 'Z' is unknown"):
        seen_shares("Z", {}, np.zeros((1, 2)))
    layout = Layout(family="rect")
    with pytest.raises(UsageError, match="no set of faces"):
        likeliest_set(model_of(np.zeros((3, 3)), layout, (0.0, 1.0), area_m2=1.0, noise="gaussian", face_weight=None), np.zeros(9), [])
