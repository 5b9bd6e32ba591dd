"""Triangles to a CAD solid: what Open Cascade reads back, against closed forms."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pytest

from predicates import box, l_beam, moved, rotation, sphere, torus
from scan2fea.cad import CadOptions, to_brep
from scan2fea.cad.brep import VOLUME_AGREES
from scan2fea.errors import CadError, RepairError
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.types import TriangleMesh


def read(step):
    """The shape as any Open Cascade program reads it: solids, faces, valid, volume in mm3, (f, 3) normals and centres of the faces in order."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GeomAbs import GeomAbs_Plane
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_REVERSED, TopAbs_SOLID, TopAbs_WIRE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.step"
        path.write_text(step)
        reader = STEPControl_Reader()
        reader.ReadFile(str(path))
        reader.TransferRoots()
        shape = reader.OneShape()
    count = {}
    for name, kind in {"solids": TopAbs_SOLID, "wires": TopAbs_WIRE, "edges": TopAbs_EDGE}.items():
        walk = TopExp_Explorer(shape, kind)
        count[name] = 0
        while walk.More():
            count[name] += 1
            walk.Next()
    normals, centres = [], []
    walk = TopExp_Explorer(shape, TopAbs_FACE)
    while walk.More():
        face = TopoDS.Face(walk.Current())
        surface = BRepAdaptor_Surface(face)
        assert surface.GetType() == GeomAbs_Plane
        axis = surface.Plane().Axis().Direction()
        sign = -1 if face.Orientation() == TopAbs_REVERSED else 1
        normals.append([sign * axis.X(), sign * axis.Y(), sign * axis.Z()])
        props = GProp_GProps()
        BRepGProp.SurfaceProperties_s(face, props)
        at = props.CentreOfMass()
        centres.append([at.X(), at.Y(), at.Z()])
        walk.Next()
    props = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, props)
    return {
        **count,
        "valid": BRepCheck_Analyzer(shape).IsValid(),
        "volume_mm3": props.Mass(),
        "normals": np.array(normals),
        "centres": np.array(centres),
    }


def frame_with_hole():
    """A square ring 3 x 3 x 1: nine blocks without the middle one, 10 plane faces of which two have a hole; volume 8."""
    blocks = [box().vertices[box().faces] + [i, j, 0] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    tri = np.concatenate(blocks)
    pair = {}
    for k, corner in enumerate(np.round(tri, 9).tolist()):  # squares between two blocks: each side has its triangles on the same four corners
        low, high = np.min(corner, axis=0), np.max(corner, axis=0)
        pair.setdefault((*low, *high), []).append(k)
    outer = sorted(k for rows in pair.values() if len(rows) == 2 for k in rows)
    vertices, rows = np.unique(np.round(tri[outer].reshape(-1, 3), 9), axis=0, return_inverse=True)
    return TriangleMesh(vertices=vertices, faces=rows.reshape(-1, 3).astype(np.int64))


def assert_proved(brep, mesh):
    assert brep.is_valid
    assert (brep.n_solids, brep.n_free_edges) == (1, 0)
    assert brep.volume_m3 == pytest.approx(volume(mesh), rel=VOLUME_AGREES)
    assert brep.area_m2 == pytest.approx(area(mesh), rel=1e-6)
    back = read(brep.step)
    assert back["valid"]
    assert back["solids"] == 1
    assert back["volume_mm3"] == pytest.approx(volume(mesh) * 1e9, rel=VOLUME_AGREES)
    assert len(back["normals"]) == len(brep.face_names) == len(brep.face_kinds) == len(brep.region_of_face) == len(brep.facet_of_face)
    assert "SI_UNIT(.MILLI.,.METRE.)" in brep.step
    return back


@pytest.mark.parametrize("pitch", [None, 0.05])
@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (5e-3 / 0.5, 1000.0), (60.0, 1000.0)])
def test_l_beam_has_eight_faces_at_any_scale_place_and_rotation(pitch, scale, shift):
    solid = l_beam(length=3.048, pitch=pitch)
    solid = TriangleMesh(vertices=solid.vertices * scale, faces=solid.faces)
    solid = moved(solid, rotation(3), np.array([shift, -shift, shift]))
    brep = to_brep(solid)
    back = assert_proved(brep, solid)
    assert len(brep.face_names) == 8
    assert back["edges"] == 2 * 18  # 6 + 6 + 6 edges, each used by two faces
    assert set(brep.face_kinds) == {"plane"}
    assert brep.face_names == tuple(f"FACE_{k:02d}_PLANE" for k in range(1, 9))


def test_closed_form_of_the_l_beam():
    brep = to_brep(l_beam(a=0.127, b=0.127, t=0.00635, length=3.048))
    assert brep.volume_m3 == pytest.approx((0.127 + 0.127 - 0.00635) * 0.00635 * 3.048, rel=1e-12)


def test_holes_are_inner_wires():
    solid = frame_with_hole()
    brep = to_brep(solid)
    back = assert_proved(brep, solid)
    assert brep.volume_m3 == pytest.approx(8.0, rel=1e-12)
    assert len(brep.face_names) == 10
    assert back["wires"] == 12  # top and bottom have two


@pytest.mark.parametrize("solid", [sphere(rounds=2), moved(sphere(rounds=2), rotation(1), np.array([1000.0, 0, 0]))])
def test_free_form_is_facets(solid):
    brep = to_brep(solid)
    assert_proved(brep, solid)
    assert brep.facet_of_face.tolist() == list(range(len(solid.faces)))
    assert (brep.region_of_face == -1).all()
    assert brep.face_names[0] == "FACE_001_FACET"


def test_torus_merges_its_flat_quads():
    solid = torus(n=24, m=12)
    assert_proved(to_brep(solid), solid)


def test_regions_and_facets_point_back_to_the_surface():
    """Each B-Rep face has the normal and the centre of the triangles it names."""
    solid = moved(box(pitch=0.25), rotation(5), np.array([3.0, 2.0, 1.0]))
    vertices = solid.vertices.copy()
    vertices[np.argmax(vertices[:, 2])] *= 1.03  # one corner moved: its faces become facets, the rest stays plane
    solid = TriangleMesh(vertices=vertices, faces=solid.faces)
    brep = to_brep(solid)
    back = assert_proved(brep, solid)
    label = planar_regions(solid).label
    assert {"plane", "facet"} == set(brep.face_kinds)
    tri = solid.vertices[solid.faces]
    vector = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    for k, (region, facet) in enumerate(zip(brep.region_of_face, brep.facet_of_face, strict=True)):
        rows = label == region if region >= 0 else np.arange(len(label)) == facet
        assert rows.any()
        mean = vector[rows].sum(0)
        weight = np.linalg.norm(vector[rows], axis=1)
        assert back["normals"][k] @ mean / np.linalg.norm(mean) > 1 - 1e-6
        assert back["centres"][k] / 1000 == pytest.approx((tri[rows].mean(1) * weight[:, None]).sum(0) / weight.sum(), abs=1e-6)


def test_regions_of_the_remesher_are_believed():
    solid = l_beam(pitch=0.05)
    label = planar_regions(solid).label
    marked = TriangleMesh(vertices=solid.vertices, faces=solid.faces, face_region=label * 3 + 2)
    assert sorted(to_brep(marked).region_of_face.tolist()) == sorted((np.unique(label) * 3 + 2).tolist())


def test_jagged_region_keeps_a_valid_border():
    """A fifth of the vertices of a plate lifted at random: what stays flat has borders of every shape."""
    plate = box((0.5, 0.3, 0.005), pitch=0.02)
    vertices = plate.vertices.copy()
    top = (vertices[:, 2] > 0.004) & (np.abs(vertices[:, 0] - 0.25) < 0.24) & (np.abs(vertices[:, 1] - 0.15) < 0.14)
    vertices[top, 2] += np.random.default_rng(0).choice([0, 1e-4], top.sum(), p=[0.8, 0.2])
    rough = TriangleMesh(vertices=vertices, faces=plate.faces)
    assert planar_regions(rough).n_cut_off > 0
    assert_proved(to_brep(rough), rough)


def test_same_text_twice_and_input_untouched():
    solid = moved(l_beam(pitch=0.05), rotation(3), np.ones(3))
    before = solid.vertices.copy()
    assert to_brep(solid).step == to_brep(solid).step
    assert np.array_equal(before, solid.vertices)
    assert "1970-01-01T00:00:00" in to_brep(solid).step


def test_order_of_triangles_gives_the_same_solid():
    solid = l_beam(pitch=0.05)
    shuffled = TriangleMesh(vertices=solid.vertices, faces=solid.faces[np.random.default_rng(0).permutation(len(solid.faces))])
    a, b = to_brep(solid), to_brep(shuffled)
    assert (len(a.face_names), a.volume_m3) == (len(b.face_names), pytest.approx(b.volume_m3, rel=1e-12))


def test_limit_of_faces_is_inclusive():
    ball = sphere(rounds=1)
    assert len(to_brep(ball, CadOptions(max_faces=80)).face_names) == 80
    with pytest.raises(CadError, match=r"80 faces, cad\.max_faces allows 79"):
        to_brep(ball, CadOptions(max_faces=79))


def two_solids():
    one = box()
    return TriangleMesh(vertices=np.vstack([one.vertices, one.vertices + 5]), faces=np.vstack([one.faces, one.faces + len(one.vertices)]))


@pytest.mark.parametrize(
    ("mesh", "error", "says"),
    [
        (TriangleMesh(vertices=box().vertices, faces=box().faces[:, ::-1].copy()), CadError, "inside out or flat"),
        (TriangleMesh(vertices=box().vertices, faces=box().faces[1:]), RepairError, "repair it first"),
        (TriangleMesh(vertices=box().vertices * np.nan, faces=box().faces), CadError, "not finite"),
        (TriangleMesh(vertices=box().vertices, faces=box().faces[:3]), CadError, "at least 4"),
        (two_solids(), CadError, "2 separate surfaces"),
    ],
)
def test_errors_say_what_is_wrong(mesh, error, says):
    with pytest.raises(error, match=says):
        to_brep(mesh)


def test_plane_faces_that_fail_fall_back_to_facets(monkeypatch):
    """The first read-back is spoilt: all triangles become facets, and nothing claims to be a plane face."""
    import sys

    module = sys.modules["scan2fea.cad.brep"]
    real, calls = module.read_back, []

    def spoilt(step):
        calls.append(step)
        found = real(step)
        return dataclasses.replace(found, is_valid=False) if len(calls) == 1 else found

    monkeypatch.setattr(module, "read_back", spoilt)
    brep = to_brep(box(pitch=0.5))
    assert set(brep.face_kinds) == {"facet"}
    monkeypatch.setattr(module, "read_back", lambda step: dataclasses.replace(real(step), n_free_edges=2))
    with pytest.raises(CadError, match="2 edges belong to one face only"):
        to_brep(box())
