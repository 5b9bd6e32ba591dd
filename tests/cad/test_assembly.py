"""One STEP file of several solids."""

import numpy as np
import pytest

from predicates import box, moved, sphere
from scan2fea.cad import assembly, to_brep
from scan2fea.errors import CadError
from scan2fea.types import TriangleMesh


@pytest.fixture(scope="module")
def parts():
    return [to_brep(box()), to_brep(moved(sphere(rounds=1), np.eye(3), np.array([5.0, 5.0, 5.0])))]


def read_named(step, tmp_path):
    """{name: (volume_mm3, colour or None)} of the parts, with Open Cascade's document reader."""
    from OCP.BRepGProp import BRepGProp
    from OCP.collections import Sequence_TDF_Label
    from OCP.GProp import GProp_GProps
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

    path = tmp_path / "assembly.step"
    path.write_text(step)
    document = TDocStd_Document(TCollection_ExtendedString("MDTV-XCAF"))
    reader = STEPCAFControl_Reader()
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    reader.ReadFile(str(path))
    assert reader.Transfer(document)
    shapes, colours = XCAFDoc_DocumentTool.ShapeTool_s(document.Main()), XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    labels, found = Sequence_TDF_Label(), {}
    shapes.GetShapes(labels)
    for k in range(1, labels.Length() + 1):
        name = TDataStd_Name()
        labels.Value(k).FindAttribute(TDataStd_Name.GetID_s(), name)
        shape, colour, props = shapes.GetShape_s(labels.Value(k)), Quantity_Color(), GProp_GProps()
        BRepGProp.VolumeProperties_s(shape, props)
        known = colours.GetColor(shape, XCAFDoc_ColorType.XCAFDoc_ColorSurf, colour) or colours.GetColor(
            shape, XCAFDoc_ColorType.XCAFDoc_ColorGen, colour
        )
        found[name.Get().ToExtString()] = (props.Mass(), colour.Values(Quantity_TOC_sRGB) if known else None)
    return found


def test_names_colours_volumes(parts, tmp_path):
    names = ["01 L-beam", "Kugel 'ä' \\"]
    found = read_named(assembly(parts, names, [(1.0, 0.0, 0.0), (0.2, 0.4, 0.6)]), tmp_path)
    assert set(found) == {"ASSEMBLY", *names}
    for name, part, colour in zip(names, parts, [(1, 0, 0), (0.2, 0.4, 0.6)], strict=True):
        assert found[name][0] == pytest.approx(part.volume_m3 * 1e9, rel=1e-9)
        assert found[name][1] == pytest.approx(colour, abs=1e-5)
    assert found["ASSEMBLY"][0] == pytest.approx(sum(p.volume_m3 for p in parts) * 1e9, rel=1e-9)


def test_without_colours_and_same_text_twice(parts, tmp_path):
    text = assembly(parts, ["a", "b"])
    assert text == assembly(parts, ["a", "b"])
    assert read_named(text, tmp_path)["a"][1] is None


def test_every_number_is_defined_once(parts):
    import re

    text = assembly([*parts, parts[0]], ["a", "b", "c"], [(0, 0, 0)] * 3)
    defined = re.findall(r"^#(\d+)=", text, re.M)
    assert len(defined) == len(set(defined))
    assert set(re.findall(r"#(\d+)", text)) == set(defined)


def test_errors(parts):
    with pytest.raises(CadError, match="at least one"):
        assembly([], [])
    with pytest.raises(CadError, match="2 solids, but 1 names"):
        assembly(parts, ["a"])
    with pytest.raises(CadError, match="from 0 to 1"):
        assembly(parts, ["a", "b"], [(255, 0, 0), (0, 0, 0)])


def test_single_triangle_mesh_is_not_needed_to_be_at_the_origin(tmp_path):
    far = TriangleMesh(vertices=box().vertices + 1000.0, faces=box().faces)
    assert read_named(assembly([to_brep(far)], ["far"]), tmp_path)["far"][0] == pytest.approx(1e9, rel=1e-9)
