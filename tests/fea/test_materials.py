import pytest

from scan2fea.errors import UsageError
from scan2fea.fea import MATERIALS, FeaOptions, material
from scan2fea.fea.materials import chosen_material


def test_every_material_is_complete_and_plausible():
    for name, m in MATERIALS.items():
        assert m.name == name and m.source
        assert 2e10 < m.youngs_pa < 3e11
        assert 0.15 < m.poisson < 0.4
        assert 2000 < m.density_kg_m3 < 9000
        assert m.yield_pa is None or 1e8 < m.yield_pa < 1e9


def test_names_forgive_case_spaces_and_prefix():
    assert material("s355").yield_pa == 355e6
    assert material("a992").name == "ASTM A992"
    assert material(" astm  a36 ").yield_pa == 250e6
    assert material("304").name == "AISI 304"


def test_unknown_name_suggests_the_nearest():
    with pytest.raises(UsageError, match="did you mean S235"):
        material("S2335")


def test_options_replace_constants():
    m = chosen_material(FeaOptions(material="6061-T6", youngs_pa=7e10))
    assert m.youngs_pa == 7e10 and m.density_kg_m3 == material("6061-T6").density_kg_m3
    assert "youngs_pa set by the user" in m.source
    assert chosen_material(FeaOptions()) is material("S235")
