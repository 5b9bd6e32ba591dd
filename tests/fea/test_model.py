import numpy as np
import pytest

from fea.bars import bar, kuhn, l_bar, quadratic, tagged
from scan2fea.errors import SolveError, UsageError
from scan2fea.fea import FeaOptions, build_model
from scan2fea.fea.model import face_sets, set_name
from scan2fea.types import TetMesh


def turned(mesh, angle_deg, axis=0):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    i, j = [k for k in range(3) if k != axis]
    rotation = np.eye(3)
    rotation[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return renamed(mesh, nodes=mesh.nodes @ rotation.T)


def renamed(mesh, names=None, tag=None, nodes=None):
    return TetMesh(
        nodes=mesh.nodes if nodes is None else nodes,
        tets=mesh.tets,
        boundary=mesh.boundary,
        face_tag=mesh.face_tag if tag is None else tag,
        face_names=mesh.face_names if names is None else names,
    )


def held(model):
    return model.mesh.nodes[model.node_sets[next(iter(model.supports))]]


def test_box_stands_on_its_bottom():
    mesh = bar((1, 2, 3), (2, 3, 4))
    model = build_model(mesh)
    assert model.supports == {"LOWEST": "xyz"}
    assert (held(model)[:, 2] == 0).all() and len(held(model)) == 5 * 7
    assert (model.acceleration_m_s2 == [0, 0, -9.80665]).all()
    assert (model.node_sets["ALL"] == np.arange(len(mesh.nodes))).all()
    faces = [name for name in model.node_sets if name.startswith("FACE_")]
    assert sorted(faces) == sorted(mesh.face_names)
    for name, value, axis in (("x", 1.0, 0), ("y", 2.0, 1), ("z", 3.0, 2)):
        assert (held(build_model(mesh, FeaOptions(down=f"+{name}")))[:, axis] == value).all()


@pytest.mark.parametrize(("angle", "plane"), [(9.9, True), (10.1, False)])
def test_a_tilted_bottom_carries_up_to_ten_degrees(angle, plane):
    mesh = bar((1, 1, 4), (2, 2, 8))
    model = build_model(turned(mesh, angle))
    bottom = np.flatnonzero(mesh.nodes[:, 2] == 0)
    assert (set(bottom) == set(model.node_sets["LOWEST"])) == plane
    spread = np.linalg.svd(held(model) - held(model).mean(axis=0), compute_uv=False)
    assert spread[1] > 1e-3 * spread[0]


def test_four_feet_stand_together_and_a_table_top_does_not_carry():
    keep = np.zeros((5, 5, 4), bool)
    keep[:, :, 3] = True
    for i in (0, 4):
        for j in (0, 4):
            keep[i, j] = True
    nodes, tets = quadratic(*kuhn(keep, np.arange(6.0), np.arange(6.0), np.arange(5.0)))
    model = build_model(tagged(nodes, tets))
    assert (held(model)[:, 2] == 0).all() and len(held(model)) == 4 * 9


def test_a_point_below_carries_by_a_widened_band():
    """A cube on its corner: no face looks down; the band grows until it has an area."""
    mesh = turned(turned(bar((1, 1, 1), (6, 6, 6)), 45), 35.264, axis=1)
    model = build_model(mesh)
    points = held(model)
    height = np.ptp(mesh.nodes[:, 2])
    assert 3 <= len(points) < 0.1 * len(mesh.nodes)
    assert np.ptp(points[:, 2]) < 0.3 * height
    assert points[:, 2].min() == mesh.nodes[:, 2].min()


def test_a_small_flat_at_the_bottom_does_not_carry():
    """A face of less than 1 % of what is seen from below is a touch, not a stand."""
    mesh = bar((10, 10, 10), (10, 10, 10))
    _, tag = np.unique(mesh.face_tag, return_inverse=True)
    first = np.flatnonzero((mesh.nodes[mesh.boundary][:, :, 2] == 0).all(axis=1))
    tag = np.array(tag)
    tag[first] = tag.max() + 1 + np.arange(len(first))  # the bottom in single facets
    names = tuple(f"FACE_{k}_PLANE" for k in range(tag.max() + 1))
    nodes = np.array(mesh.nodes)
    low = nodes[:, 2] == 0
    nodes[low, 2] += 1.5 * (((nodes[low, :2] - 5) ** 2).sum(axis=1) / 50)  # bulges downwards: only its middle is low
    model = build_model(renamed(mesh, names, tag, nodes))
    centre = np.linalg.norm(held(model)[:, :2] - 5, axis=1)
    assert len(held(model)) >= 3 and centre.max() < 4


def test_facets_become_one_set_and_names_stay_apart():
    mesh = bar((1, 1, 1), (1, 1, 1))
    names = ("FACE_01_PLANE", "face 01 plane", "FACE_03_FACET", "FACE_04_FACET", "LOWEST", "9" + "é" * 100)
    found, number = face_sets(renamed(mesh, names))
    assert found == ("FACE_01_PLANE", "FACE_01_PLANE_2", "FACETS", "LOWEST_2", "F_9")
    assert (number[mesh.face_tag == 2] == 2).all() and (number[mesh.face_tag == 3] == 2).all()
    assert set_name("a" * 100) == "A" * 80
    model = build_model(renamed(mesh, names))
    assert set(model.node_sets) == {*found, "ALL", "LOWEST"}


def test_l_bar_on_end_and_lying():
    mesh = l_bar(0.127, 0.00635, 1.0, 3, 6)
    assert (held(build_model(mesh))[:, 2] == 0).all()
    assert (held(build_model(mesh, FeaOptions(down="-x")))[:, 0] == 0).all()


def test_messages():
    mesh = bar((1, 1, 1), (1, 1, 1))
    with pytest.raises(UsageError, match=r"fea\.down is 'z'"):
        build_model(mesh, FeaOptions(down="z"))
    with pytest.raises(SolveError, match=r"81 degrees of freedom are above fea\.max_dof = 80"):
        build_model(mesh, FeaOptions(max_dof=80))
    empty = TetMesh(
        nodes=np.zeros((0, 3)), tets=np.zeros((0, 4), np.int64), boundary=np.zeros((0, 3), np.int64), face_tag=np.zeros(0, np.int64), face_names=()
    )
    with pytest.raises(SolveError, match="no tetrahedra"):
        build_model(empty)
