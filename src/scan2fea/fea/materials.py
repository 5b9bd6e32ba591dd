"""Linear elastic materials, from the standards that define them."""

from __future__ import annotations

import difflib
import re
from dataclasses import replace

from scan2fea.errors import UsageError
from scan2fea.fea.options import FeaOptions
from scan2fea.types import Material

# EN 1993-1-1 (3.2.6): E = 210 GPa, nu = 0.3; EN 1991-1-1 table A.4: 77.0 to 78.5 kN/m3, that is 7850 kg/m3
_EC3 = "EN 1993-1-1:2005, 3.2.6 and table 3.1 (t <= 40 mm); density EN 1991-1-1 table A.4"
# AISC 360-16 takes E = 29 000 ksi = 199.95 GPa for all structural steels; 490 lb/ft3 = 7849 kg/m3
_AISC = "E 29 000 ksi: AISC 360-16; density 490 lb/ft3: AISC Steel Construction Manual"


def _steel(name: str, yield_pa: float, source: str, youngs_pa: float) -> Material:
    return Material(name=name, youngs_pa=youngs_pa, poisson=0.3, density_kg_m3=7850.0, yield_pa=yield_pa, source=source)


_TABLE = (
    _steel("S235", 235e6, _EC3, 210e9),
    _steel("S275", 275e6, _EC3, 210e9),
    _steel("S355", 355e6, _EC3, 210e9),
    _steel("ASTM A36", 250e6, f"yield 36 ksi: ASTM A36/A36M; {_AISC}", 199.95e9),
    _steel("ASTM A572 Gr50", 345e6, f"yield 50 ksi: ASTM A572/A572M grade 50; {_AISC}", 199.95e9),
    _steel("ASTM A992", 345e6, f"yield 50 ksi: ASTM A992/A992M; {_AISC}", 199.95e9),
    Material(
        name="C30/37",
        youngs_pa=33e9,
        poisson=0.2,
        density_kg_m3=2500.0,
        yield_pa=None,
        source="Ecm, nu: EN 1992-1-1:2004, table 3.1 and 3.1.3 (uncracked); density with reinforcement: EN 1991-1-1 table A.1",
    ),
    Material(
        name="6061-T6",
        youngs_pa=68.9e9,
        poisson=0.33,
        density_kg_m3=2700.0,
        yield_pa=240e6,
        source="yield 35 ksi: ASTM B209/B221 (6061-T6); E, nu, density: Aluminum Design Manual 2015 (10 000 ksi)",
    ),
    Material(
        name="AISI 304",
        youngs_pa=200e9,
        poisson=0.3,
        density_kg_m3=7900.0,
        yield_pa=210e6,
        source="1.4301: EN 1993-1-4:2006, 2.1 and table 2.1 (hot-rolled); density EN 10088-1",
    ),
)

MATERIALS: dict[str, Material] = {m.name: m for m in _TABLE}

_ALIASES = {
    "A36": "ASTM A36",
    "A572": "ASTM A572 Gr50",
    "ASTM A572": "ASTM A572 Gr50",
    "A992": "ASTM A992",
    "304": "AISI 304",
    "1.4301": "AISI 304",
    "STEEL": "S235",
    "CONCRETE": "C30/37",
    "C30": "C30/37",
    "ALUMINIUM": "6061-T6",
    "AL6061-T6": "6061-T6",
    "STAINLESS": "AISI 304",
}


def _key(name: str) -> str:
    return re.sub(r"[\s_]+", " ", name.strip().upper())


def material(name: str) -> Material:
    """The named material (case and spaces do not matter). Raises UsageError with the nearest name."""
    known = {_key(m): m for m in MATERIALS} | {_key(alias): target for alias, target in _ALIASES.items()}
    if _key(name) in known:
        return MATERIALS[known[_key(name)]]
    near = difflib.get_close_matches(_key(name), known, n=1, cutoff=0.4)
    hint = f"; did you mean {known[near[0]]}?" if near else ""
    raise UsageError(f"material {name!r} is not known: use one of {', '.join(MATERIALS)}{hint}")


def chosen_material(options: FeaOptions) -> Material:
    """The material of the options, with the constants that the options replace. Raises UsageError."""
    base = material(options.material)
    own = {key: getattr(options, key) for key in ("youngs_pa", "poisson", "density_kg_m3") if getattr(options, key) is not None}
    if not own:
        return base
    return replace(base, **own, name=f"{base.name} (changed)", source=f"{base.source}; {', '.join(sorted(own))} set by the user")
