"""Pipes with elbows: fitted laid out straight, bent back, built, and as a wireframe."""

import dataclasses
import math
from pipes import Pipe, points_of

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented
from scan2fea.cad import prism_brep
from scan2fea.estimation.elbows import runs_of
from scan2fea.estimation.frame import frame
from scan2fea.estimation.layers import layers_of
from scan2fea.estimation.member import MemberOptions
from scan2fea.estimation.solid import solid_of
from scan2fea.kernel.bends import bent
from scan2fea.kernel.measures import volume
from scan2fea.kernel.transforms import applied
from scan2fea.pipeline.route import RouteOptions, estimate
from scan2fea.tetmeshing import layered
from scan2fea.types import PointCloud, Scan

PIPE = Pipe(d=0.0889, t=0.0055, runs=(0.5, 0.7), turns=((math.pi / 2, 0.8),), radius=0.133)
AREA = math.pi * PIPE.t * (PIPE.d - PIPE.t)


@pytest.fixture(scope="module")
def fitted():
    points, T = points_of(PIPE, 0.006, 0.0004, seed=4)
    return points, T, estimate(Scan(cloud=PointCloud.of(points)), MemberOptions(), RouteOptions())


def test_every_dimension_with_its_deviation(fitted):
    _, _, found = fitted
    assert found.explains and found.member.family == "CHS" and found.reason.startswith("pipe with 1 bend (90.0 deg")
    truth = {"d": PIPE.d, "t": PIPE.t, "length": PIPE.length}
    for p in found.member.parameters:
        assert p.observable and abs(p.value_m - truth[p.name]) < 4 * p.std_m
    bend = found.member.bends[0]
    assert abs(bend.radius_m - PIPE.radius) < 4 * bend.radius_std_m and abs(bend.angle_rad - math.pi / 2) < 4 * bend.angle_std_rad


def test_it_lies_where_the_pipe_does(fitted):
    _, T, found = fitted
    member = found.member
    local = np.column_stack([np.zeros((5, 2)), np.linspace(0, member.values()["length"], 5)])
    own = applied(member.T_world_member, bent(member.bends, local))
    true = applied(T, bent(PIPE.bends, np.column_stack([np.zeros((5, 2)), np.linspace(0, PIPE.length, 5)])))
    assert min(np.abs(own - true).max(), np.abs(own[::-1] - true).max()) < 1e-3


def test_the_solid_is_closed_and_true(fitted):
    solid = solid_of(fitted[2].member)
    assert_closed_manifold_oriented(solid.mesh)
    member = fitted[2].member
    exact = math.pi * member.values()["t"] * (member.values()["d"] - member.values()["t"]) * member.values()["length"]
    assert volume(solid.mesh) == pytest.approx(exact, rel=2e-3)
    brep = prism_brep(solid.shape, solid.sweep)
    assert brep.is_valid and brep.volume_m3 == pytest.approx(exact, rel=1e-5)
    assert sorted(brep.face_kinds) == ["cylinder"] * 4 + ["plane"] * 2 + ["torus"] * 2
    assert {"OUTER_RUN_1", "OUTER_BEND_1", "OUTER_RUN_2", "INNER_BEND_1", "END_FIRST", "END_LAST"} < set(brep.face_names)
    at = layers_of(solid)
    tets = layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names)
    corners = tets.nodes[tets.tets[:, :4]]
    assert (np.linalg.det(corners[:, 1:] - corners[:, :1]) > 0).all()


def test_oblique_ends_are_cut(fitted):
    member = fitted[2].member
    slant = np.array([[0.2, 0.0, -1.0], [0.0, 0.1, 1.0]])
    solid = solid_of(dataclasses.replace(member, end_normals=slant / np.linalg.norm(slant, axis=1)[:, None]))
    assert_closed_manifold_oriented(solid.mesh)
    brep = prism_brep(solid.shape, solid.sweep)
    assert brep.is_valid and len(brep.face_names) == 8


def test_the_wireframe_runs_from_corner_to_corner(fitted):
    runs = runs_of(fitted[2].member)
    wire = frame(runs)
    assert len(runs) == 2 and len(wire.nodes) == 3 and len(wire.elements) == 2
    cut = PIPE.radius
    assert sorted(run.values()["length"] for run in runs) == pytest.approx([0.5 + cut, 0.7 + cut], abs=2e-3)


def test_from_outside_the_wall_is_not_told():
    points, _ = points_of(PIPE, 0.006, 0.0004, seed=6, inside=False, caps=False)
    found = estimate(Scan(cloud=PointCloud.of(points)), MemberOptions(), RouteOptions())
    assert found.member is not None and len(found.member.bends) == 1
    told = {p.name: p for p in found.member.parameters}
    assert abs(told["d"].value_m - PIPE.d) < 4 * told["d"].std_m
    assert "t" not in told or not told["t"].observable
