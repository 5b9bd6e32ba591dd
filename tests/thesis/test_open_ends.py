"""What the thesis left open: the true beam's response, and the specimens of the hypotheses."""

import dataclasses

import numpy as np
import pytest

from scan2fea.estimation.layers import layers_of
from scan2fea.estimation.solid import solid_of
from scan2fea.kernel.measures import face_vectors
from scan2fea.pipeline.requires import conditions
from scan2fea.tetmeshing import layered
from scan2fea.thesis import ThesisOptions
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.conclusion import theory, true_member, wall_bound
from scan2fea.thesis.hypotheses import FREE_M, VIEWS, WALL_M, Trial, free_trial, limits, scale_limits, seen_points, specimen
from scan2fea.thesis.own_meshes import thesis_meshes, with_ends


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench(folder=tmp_path_factory.mktemp("kept"), options=ThesisOptions(quick=True))


def test_the_true_beam_bends_as_its_closed_form_says(bench):
    # thesis-notes 5.7: 1 N along a leg moves the tip by 0.02920 mm along and 0.01747 across, shear and twist left out
    assert theory(bench)["bend_x tip_x_m"] / 100 == pytest.approx(2.92e-5, rel=0.015)
    assert theory(bench)["mass mass_kg"] == pytest.approx(37.63, abs=0.01)
    assert true_member().values() == {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 3.048}


def test_the_ends_of_a_mesh_are_what_looks_along_its_axis_there():
    member = true_member()
    at = layers_of(solid_of(member))
    tets = layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names)
    turned, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turned * np.sign(np.linalg.det(turned)), (3.0, -1.0, 2.0)
    found = with_ends(dataclasses.replace(tets, nodes=tets.nodes @ T[:3, :3].T + T[:3, 3]), T)
    size = np.linalg.norm(face_vectors(found.nodes, np.asarray(found.boundary[:, :3])), axis=1)
    section = WALL_M * (2 * 0.127 - WALL_M)
    assert [size[found.face_tag == k].sum() for k in (1, 2)] == pytest.approx([section, section], rel=1e-9)
    z = ((found.nodes - T[:3, 3]) @ T[:3, 2])[found.boundary[:, :3]]
    assert z[found.face_tag == 1].max() == pytest.approx(z.min()) and z[found.face_tag == 2].min() == pytest.approx(z.max())


def test_a_quick_run_leaves_the_thesis_own_meshes_to_a_full_one(bench):
    made = thesis_meshes(bench)
    assert made.table is None and not made.failed and "full run" in made.says[0]


def test_no_method_tells_a_wall_better_than_its_bound():
    # the information of one point about t, of two faces t apart under a normal law of known sigma, by quadrature
    sigma, x = 6.7e-3, np.linspace(-0.06, 0.06, 20_001)

    def density(t):
        return sum(np.exp(-0.5 * ((x - m) / sigma) ** 2) for m in (-t / 2, t / 2)) / (2 * sigma * np.sqrt(2 * np.pi))

    for t, rel in ((1e-3, 0.01), (WALL_M, 0.04)):
        slope = (density(1.001 * t) - density(0.999 * t)) / (0.002 * t)
        information = np.trapezoid(slope**2 / density(t), x)
        assert wall_bound(t, sigma, 15_000) == pytest.approx((15_000 * information) ** -0.5, rel=rel)


def test_views_hide_what_they_say(bench):
    solid = specimen(bench, FREE_M)
    d = solid.shape.parameters
    section = d["t"] * (2 * d["a"] - d["t"])
    whole = 4 * d["a"] * FREE_M + 2 * section
    area = {
        "all round": whole, "without ends": whole - 2 * section, "outer faces": 2 * d["a"] * FREE_M, "one leg": d["a"] * FREE_M,
    }  # fmt: skip
    for view, hidden in VIEWS.items():
        points, share = seen_points(solid, 8e-3, 0.0, hidden, 0)
        assert share == pytest.approx(area[view] / whole, rel=1e-9)
        own = (points - solid.T_world_shape[:3, 3]) @ solid.T_world_shape[:3, :3]
        if view == "outer faces":
            assert (np.abs(own[:, :2]).min(axis=1) < 1e-12).all()
        if view == "one leg":
            assert (np.abs(own[:, 0]) < 1e-12).all()


def test_a_clean_dense_specimen_converts_and_a_noisy_one_says_why(bench):
    solid = specimen(bench, 0.04)
    assert free_trial(solid, 3e-3, 0.0, (), 0) == ""
    assert free_trial(solid, 3e-3, 6e-3, (), 0) != ""


def test_the_shipped_conditions_convert(bench):
    limit = conditions()
    assert free_trial(specimen(bench, FREE_M), limit["spacing_walls"] * WALL_M, limit["noise_walls"] * WALL_M, (), 0) == ""


def test_a_wall_wider_than_the_ball_stays_and_a_thinner_one_closes(bench):
    made = scale_limits(bench)
    rows = made.table.rows
    whole, closed = max(row[3] for row in rows if row[-1] > 0.99), min(row[3] for row in rows if row[-1] < 0.01)
    assert f"left at radii up to {whole:.2f} walls, none at {closed:.2f} walls" in made.says[0]
    left = {row[3]: row[4:] for row in rows}
    assert all(kept == pytest.approx([1, 1, 1, 1], abs=1e-9) for ratio, kept in left.items() if ratio < 0.9)
    assert all(kept[-1] < 1e-6 for ratio, kept in left.items() if ratio > 1.1)
    assert min(left) < 0.9 and max(left) > 1.1


def test_limits_are_read_off_the_maps(bench, monkeypatch):
    def trial(_, kind, noise_mm, column):
        return Trial(success=1.0 if noise_mm <= (1.0 if kind == "free" else 6.0) and column != "8" else 0.0, reason="")

    monkeypatch.setattr("scan2fea.thesis.hypotheses.trials", trial)
    rows = limits(bench).table.rows
    assert [row[2] for row in rows[:2]] == [pytest.approx(1e-3 / WALL_M), None]
    assert len(rows) == 4 and all(row[2] == pytest.approx(6e-3 / WALL_M) for row in rows[2:])
    assert dataclasses.is_dataclass(Trial)
