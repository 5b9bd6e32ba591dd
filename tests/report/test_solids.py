"""Cuts, warps and worst elements of a tetrahedral mesh whose numbers are known."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from report.fake_out import angle_solid
from scan2fea.kernel.topology import surface_topology
from scan2fea.report.camera import look_at
from scan2fea.report.solids import Solid, _cut, cut_figure, displacement_figure, mode_figure, quality_charts, worst_elements
from scan2fea.types import TriangleMesh

ANGLE = angle_solid()
CAMERA = look_at(ANGLE.nodes, width_px=240, height_px=150)


def volume_of(nodes, faces):
    a, b, c = (nodes[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a - nodes[0], np.cross(b - nodes[0], c - nodes[0])) / 6


def tet_volume(solid, kept=slice(None)):
    p = solid.nodes[solid.tets[kept, :4]]
    return np.einsum("ij,ij->i", p[:, 1] - p[:, 0], np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 0])) / 6


def test_boundary_is_closed_and_holds_the_volume_of_the_tets():
    faces, owner = ANGLE.boundary()
    topology = surface_topology(TriangleMesh(vertices=ANGLE.nodes, faces=faces))
    assert topology.is_closed and topology.is_manifold
    assert tet_volume(ANGLE).min() > 0
    assert volume_of(ANGLE.nodes, faces) == pytest.approx(tet_volume(ANGLE).sum(), rel=1e-9)
    assert all(set(face) <= set(tet) for face, tet in zip(faces.tolist(), ANGLE.tets[owner].tolist(), strict=True))


def test_boundary_of_some_tets():
    kept = np.arange(len(ANGLE.tets)) % 3 == 0
    faces, owner = ANGLE.boundary(kept)
    assert kept[owner].all()
    assert volume_of(ANGLE.nodes, faces) == pytest.approx(tet_volume(ANGLE, kept).sum(), rel=1e-9)
    assert len(ANGLE.boundary(np.zeros(len(ANGLE.tets), bool))[0]) == 0


def test_recorded_angles_are_believed_and_others_computed():
    assert ANGLE.min_dihedral_deg().min() == pytest.approx(worst_elements(ANGLE)[0][1])
    told = replace(ANGLE, cell_data={"min_dihedral_deg": np.arange(len(ANGLE.tets), 0.0, -1)})
    assert [row[0] for row in worst_elements(told)] == [len(ANGLE.tets) - k for k in range(5)]
    number, angle, centre = worst_elements(told, 1)[0]
    assert angle == 1.0 and centre == pytest.approx(ANGLE.nodes[ANGLE.tets[number - 1]].mean(axis=0))
    assert len(worst_elements(told, 10**6)) == len(ANGLE.tets)


def test_cut_of_a_stout_and_of_a_slender_thing():
    stout = cut_figure(ANGLE, CAMERA)
    assert "Cut through the middle: 3,588 tetrahedra" in stout.caption and stout.scale_m_per_px == CAMERA.m_per_px
    long = replace(ANGLE, nodes=(ANGLE.nodes - ANGLE.nodes[0]) @ np.linalg.svd(ANGLE.nodes - ANGLE.nodes.mean(0))[2].T * [8, 1, 1])
    slender = cut_figure(long, look_at(long.nodes, width_px=240))
    assert "Cut across" in slender.caption and slender.scale_m_per_px < look_at(long.nodes, width_px=240).m_per_px / 2


def test_a_tilted_plate_is_cut_through_its_thickness_and_half_of_it_is_shown():
    side = (ANGLE.nodes - ANGLE.nodes[0]) @ np.linalg.svd(ANGLE.nodes - ANGLE.nodes.mean(0))[2].T
    tilt = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    plate = replace(ANGLE, nodes=side * [1.0, 2.0, 0.1] @ tilt)
    camera = look_at(plate.nodes, width_px=240)
    normal, across, _ = _cut(plate.nodes, camera)
    assert not across and abs(normal @ tilt[2]) < 0.1 and normal @ camera.axes[2] > 0
    picture = np.asarray(Image.open(io.BytesIO(cut_figure(plate, camera).png)).convert("RGB")).astype(int)
    assert (np.abs(picture - 250).max(axis=2) > 30).mean() > 0.05


def test_displacement_and_modes_state_their_factor():
    figure = displacement_figure(ANGLE, CAMERA)
    assert "500\u202f000 times" in figure.caption and "mm" in figure.legend
    assert mode_figure(ANGLE, CAMERA, 1, 412.5).title == "Mode 1, 412.5 Hz"
    assert mode_figure(ANGLE, CAMERA, 2, None).title == "Mode 2"
    assert mode_figure(ANGLE, CAMERA, 1, 1.0).png != mode_figure(ANGLE, CAMERA, 2, 1.0).png
    assert mode_figure(ANGLE, CAMERA, 3, None) is None


@pytest.mark.parametrize("values", [np.zeros_like(ANGLE.nodes), np.full_like(ANGLE.nodes, np.nan), np.zeros(3)])
def test_fields_that_show_nothing_are_left_out(values):
    solid = Solid(nodes=ANGLE.nodes, tets=ANGLE.tets, point_data={"displacement_m": values, "mode_1": values, "mode_x": values}, cell_data={})
    assert displacement_figure(solid, CAMERA) is None and mode_figure(solid, CAMERA, 1, None) is None


def test_quality_charts_draw_the_limits_of_solvers():
    angle, jacobian = quality_charts(ANGLE)
    assert "fails 5" in angle and "warns 15" in angle and "3,588 values" in angle
    assert "fails 0" in jacobian


def test_mid_nodes_do_not_disturb():
    mids = (ANGLE.nodes[ANGLE.tets[:, [0, 1, 0, 0, 1, 2]]] + ANGLE.nodes[ANGLE.tets[:, [1, 2, 2, 3, 3, 3]]]) / 2
    n = len(ANGLE.nodes)
    tets = np.concatenate([ANGLE.tets, n + np.arange(6 * len(ANGLE.tets)).reshape(-1, 6)], axis=1)
    quadratic = Solid(nodes=np.concatenate([ANGLE.nodes, mids.reshape(-1, 3)]), tets=tets, point_data={}, cell_data={})
    assert np.array_equal(quadratic.boundary()[0], ANGLE.boundary()[0])
    assert cut_figure(quadratic, CAMERA).png == cut_figure(ANGLE, CAMERA).png
