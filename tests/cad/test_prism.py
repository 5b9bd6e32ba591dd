"""Members as true CAD faces: counts, kinds, volumes in closed form, bends as B-splines."""

import math

import numpy as np
import pytest

from estimation.made import N_FACES, SIZES, closed_area, made
from predicates import rotation
from scan2fea.cad import assembly
from scan2fea.cad.prism import prism_brep
from scan2fea.cad.readback import read_back
from scan2fea.estimation.solid import SolidOptions, solid_of
from scan2fea.kernel.outline import outline_moments
from scan2fea.kernel.sweep import swept_volume


def brep_of(member, radius=0.0):
    solid = solid_of(member, SolidOptions(root_radius_m=radius))
    area, moment = outline_moments(solid.shape)
    return prism_brep(solid.shape, solid.sweep), swept_volume(solid.sweep, area, moment / area)


@pytest.mark.parametrize("family", SIZES)
def test_oblique_ends(family):
    """Circles become ellipses; Open Cascade integrates over those to about 1e-7."""
    brep, volume = brep_of(made(family, 2.0, normals=[[0.3, 0.1, -1], [-0.2, 0.4, 1]], R=rotation(1)))
    assert brep.is_valid and len(brep.face_names) == N_FACES[family]
    assert brep.volume_m3 == pytest.approx(volume, rel=1e-6 if family in ("CHS", "round") else 1e-11)


@pytest.mark.parametrize(("family", "n"), [("L", 9), ("I", 18), ("RHS", 18)])
def test_fillets_are_cylinders(family, n):
    brep, volume = brep_of(made(family, 2.0), radius=0.008)
    assert len(brep.face_kinds) == n
    assert brep.face_kinds.count("cylinder") == n - N_FACES[family]
    assert brep.volume_m3 == pytest.approx(volume, rel=1e-10)


@pytest.mark.parametrize("family", SIZES)
def test_bent_members_keep_their_faces(family):
    """Bow shears the member: the volume is area x length exactly. Circles are cut in quarters."""
    brep, _ = brep_of(made(family, 3.0, bow=[[0.005, 0.001], [-0.003, 0.0]]))
    assert brep.is_valid and brep.n_solids == 1 and brep.n_free_edges == 0
    assert len(brep.face_kinds) == {"CHS": 10, "round": 6}.get(family, N_FACES[family])
    assert set(brep.face_kinds) == {"nurbs", "plane"}
    assert brep.volume_m3 == pytest.approx(closed_area(family, SIZES[family]) * 3.0, rel=1e-10)


def test_twisted_members():
    brep, volume = brep_of(made("I", 3.0, twist=[0.05, 0.01]))
    assert brep.is_valid and len(brep.face_names) == 14
    assert brep.volume_m3 == pytest.approx(volume, rel=1e-6)


def test_areas_by_face():
    """Tube of 2 m: outside pi d L, inside pi (d - 2t) L, rings at the ends."""
    brep, _ = brep_of(made("CHS", 2.0))
    areas = read_back(brep.step).face_area
    d, t = 0.1143, 0.006
    ring = math.pi * t * (d - t)
    assert areas == pytest.approx([math.pi * d * 2, math.pi * (d - 2 * t) * 2, ring, ring], rel=1e-9)
    assert brep.face_names == ("OUTER", "INNER", "END_FIRST", "END_LAST")


def test_same_text_again_in_millimetres_and_in_an_assembly():
    member = made("L", 3.048, shift=(1, 2, 3))
    one, other = brep_of(member)[0], brep_of(member)[0]
    assert one.step == other.step and "SI_UNIT(.MILLI.,.METRE.)" in one.step
    both = read_back(assembly([one, brep_of(made("CHS", 1.0, shift=(5, 0, 0)))[0]], ["A", "B"]))
    assert both.n_solids == 2 and both.is_valid
    assert both.volume_m3 == pytest.approx(sum(closed_area(f, SIZES[f]) * n for f, n in (("L", 3.048), ("CHS", 1.0))), rel=1e-9)


def test_far_from_the_origin():
    brep, volume = brep_of(made("round", 1.0, shift=(9e3, -8e3, 500), R=rotation(2)))
    assert brep.is_valid and brep.volume_m3 == pytest.approx(volume, rel=1e-6)
    assert np.all(brep.facet_of_face == -1)
