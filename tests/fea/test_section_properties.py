import csv
import math
from importlib import resources

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.estimation.table import shipped_table
from scan2fea.fea.section_mesh import section_mesh
from scan2fea.fea.section_properties import properties_of
from scan2fea.kernel.outline import outline, outline_area
from scan2fea.types import RootFillet

L = ("L", {"a": 0.127, "b": 0.127, "t": 0.00635})
GIRDER = ("I", {"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085})
C = ("C", {"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115})
T = ("T", {"h": 0.1, "b": 0.1, "tw": 0.01, "tf": 0.01})
RHS = ("RHS", {"h": 0.1, "b": 0.06, "t": 0.005})
CHS = ("CHS", {"d": 0.1143, "t": 0.006})
PLATE = ("rect", {"b": 0.1, "t": 0.01})


def bar_torsion(b, t):
    """J of a rectangle by its series (Timoshenko and Goodier 1970, art. 109)."""
    total = sum(math.tanh(n * math.pi * b / (2 * t)) / n**5 for n in range(1, 200, 2))
    return b * t**3 / 3 * (1 - 192 * t / (math.pi**5 * b) * total)


# area, Ix, Iy: sums of rectangles by hand; J, Cw: solved anew with four times the elements twice over, and within 0.15 % of a second program
@pytest.mark.parametrize(
    ("section", "area", "ixx", "iyy", "j", "warping"),
    [
        (L, 1572.5775, 2.51626e6, 2.51626e6, 20913.1, 2.688e7),
        (GIRDER, 2724.8, 1.84559e7, 1.41934e6, 50646.8, 1.2976e10),
        (C, 3229.5, 1.92702e7, 1.70609e6, 107585.6, 1.0682e10),
        (T, 1900.0, 1.80004e6, 8.40833e5, 63102.0, 2.972e7),
        (RHS, 1500.0, 1.9625e6, 8.625e5, 1.88035e6, 7.071e7),
        (CHS, 2041.413, 3.00212e6, 3.00212e6, 6.00423e6, 0.0),
        (PLATE, 1000.0, 8333.33, 833333.3, bar_torsion(100, 10), 6.6429e6),
    ],
    ids=["L", "I", "C", "T", "RHS", "CHS", "plate"],
)
def test_against_known_figures(section, area, ixx, iyy, j, warping):
    p = properties_of(*section)
    assert p.area * 1e6 == pytest.approx(area, rel=1e-5)
    assert p.ixx * 1e12 == pytest.approx(ixx, rel=2e-5) and p.iyy * 1e12 == pytest.approx(iyy, rel=2e-5)
    assert p.j * 1e12 == pytest.approx(j, rel=1e-3)
    assert p.warping * 1e18 == pytest.approx(warping, rel=1e-3, abs=1e-3)
    assert p.i1 >= p.i2 > 0 and p.i1 + p.i2 == pytest.approx(p.ixx + p.iyy)


def test_shear_centres():
    assert properties_of(*L).shear_centre * 1e3 == pytest.approx([3.267, 3.267], abs=0.003)
    assert properties_of(*C).shear_centre * 1e3 == pytest.approx([-21.97, 0], abs=0.01)
    assert properties_of(*T).shear_centre * 1e3 == pytest.approx([0, -5.81], abs=0.01)
    for symmetric in (GIRDER, RHS, CHS, PLATE):
        assert properties_of(*symmetric).eccentricity == pytest.approx([0, 0], abs=1e-8)
    # thin walls: the centre of an angle lies where the middle lines of its legs cross
    thin = properties_of("L", {"a": 0.1, "b": 0.06, "t": 0.001})
    assert thin.shear_centre == pytest.approx([0.0005, 0.0005], abs=3e-5)


def test_principal_axes_of_an_angle():
    p = properties_of(*L)
    assert (p.i1 * 1e12, p.i2 * 1e12, p.ixy * 1e12) == pytest.approx((4.02127e6, 1.01126e6, -1.505e6), rel=1e-4)
    assert p.angle_rad == pytest.approx(math.pi / 4)
    assert p.centroid * 1e3 == pytest.approx([34.111, 34.111], abs=1e-3)
    assert p.reach * 1e3 == pytest.approx([34.111, 92.889, 34.111, 92.889], abs=1e-3)


def test_shear_areas():
    """5/6 of a rectangle, 6/7 of a full circle at Poisson's ratio 0, one half of a thin tube."""
    slab = properties_of(*PLATE)
    assert 1 / (np.diag(slab.shear) * slab.area) == pytest.approx([5 / 6, 5 / 6], rel=1e-3)
    disc, tube = properties_of("round", {"d": 0.05}), properties_of("CHS", {"d": 0.1, "t": 0.0005})
    assert 1 / (disc.shear[0, 0] * disc.area) == pytest.approx(6 / 7, rel=1e-3)
    assert 1 / (tube.shear[0, 0] * tube.area) == pytest.approx(0.5, rel=1e-3)
    assert disc.j == pytest.approx(math.pi * 0.05**4 / 32, rel=1e-4)


def test_scale_and_swap():
    small, big = properties_of(*L), properties_of("L", {k: 1e3 * v for k, v in L[1].items()})
    for name, power in (("area", 2), ("ixx", 4), ("j", 4), ("warping", 6)):
        assert getattr(big, name) == pytest.approx(getattr(small, name) * 1e3**power, rel=1e-9)
    one, other = properties_of("L", {"a": 0.1, "b": 0.06, "t": 0.008}), properties_of("L", {"a": 0.06, "b": 0.1, "t": 0.008})
    assert (one.ixx, one.iyy, one.j, one.warping) == pytest.approx((other.iyy, other.ixx, other.j, other.warping), rel=1e-9)
    assert one.shear_centre == pytest.approx(other.shear_centre[::-1], rel=1e-6)


@pytest.mark.parametrize("section", [L, GIRDER, C, T, RHS, CHS, PLATE], ids=lambda s: s[0])
def test_a_finer_mesh_changes_nothing_that_matters(section):
    p, q = properties_of(*section), properties_of(*section, level=2)
    assert p.j == pytest.approx(q.j, rel=5e-4) and p.warping == pytest.approx(q.warping, rel=5e-4, abs=1e-20)
    assert np.diag(p.shear) == pytest.approx(np.diag(q.shear), rel=2e-3)


def test_every_rolled_section_of_the_table_has_its_area():
    """With its root radius, within 0.1 % of the mill's table; where the toes are rounded too (EN angles, tapered flanges) the table says less."""
    text = resources.files("scan2fea.estimation").joinpath("sections.csv").read_text(encoding="utf-8")
    rows = [row for row in csv.DictReader(text.splitlines()) if row["family"] == "I" and row["r_mm"] and row["name"].startswith(("HE", "IPE"))]
    assert len(rows) > 20
    for row in rows[:: max(1, len(rows) // 12)]:
        values = {name: float(row[f"{name}_mm"]) * 1e-3 for name in ("h", "b", "tw", "tf")}
        p = properties_of("I", values, RootFillet(radius_m=float(row["r_mm"]) * 1e-3), level=0)
        assert p.area * 1e6 == pytest.approx(float(row["area_mm2"]), rel=1e-3), row["name"]


@pytest.mark.parametrize(
    ("name", "slope", "of_root", "told"),
    [("IPN 200", 0.14, 0.6, (3340, 2140, 117)), ("IPN 400", 0.14, 0.6, (11800, 29210, 1160)), ("UPN 200", 0.08, 0.5, (3220, 1910, 148))],
)
def test_sloping_flanges_and_round_toes_are_those_of_the_mills_table(name, slope, of_root, told):
    """EN 10365: area in mm2, second moments about y and z in cm4; three digits."""
    shape = shipped_table().named(name)
    root = RootFillet(radius_m=shape.root_radius_m, toe_m=of_root * shape.root_radius_m, slope=slope)
    p = properties_of(shape.family, shape.parameters, root)
    assert p.area == pytest.approx(outline_area(outline(shape.family, shape.parameters, root.radius_m, root.toe_m, slope)), rel=2e-5)
    assert [p.area * 1e6, p.ixx * 1e8, p.iyy * 1e8] == pytest.approx(told, rel=5e-3)


@pytest.mark.parametrize(("section", "radius"), [(L, 0.012), (GIRDER, 0.012), (C, 0.01), (T, 0.012), (RHS, 0.003), (RHS, 0.0075)])
def test_fillets_keep_the_area_of_the_outline(section, radius):
    shape = outline(*section, radius)
    p = properties_of(*section, RootFillet(radius_m=radius))
    assert p.area == pytest.approx(outline_area(shape), rel=2e-5)
    sharp = properties_of(*section)
    assert (p.j < sharp.j) if section is RHS and radius > 0.005 else (p.j != sharp.j)


def test_the_mesh_fills_the_section_once():
    for section in (L, GIRDER, RHS, CHS):
        mesh = section_mesh(outline(*section), 0)
        corner = mesh.points[mesh.triangles[:, :3]]
        a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()
        sides = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
        _, uses = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
        assert uses.max() == 2 and len(np.unique(sides, axis=0)) == len(sides)


def test_messages():
    with pytest.raises(UsageError, match="must be"):
        properties_of("L", {"a": 0.1, "b": 0.1, "t": 0.2})
