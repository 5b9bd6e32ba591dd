"""The cards of a Nastran deck in the language of `cards`, so that one set of rules says whether a deck would run and what it leaves free."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from scan2fea.verification.cards import MISSPELT, Card, is_near

Fields = tuple[str, ...]
SOLUTIONS = {"101": "STATIC", "1": "STATIC", "103": "FREQUENCY", "3": "FREQUENCY", "105": "BUCKLE", "106": "STATIC", "400": "STATIC"}
SECTIONS = {"PSOLID": "SOLID", "PSHELL": "SHELL", "PCOMP": "SHELL", "PBAR": "BEAM", "PBARL": "BEAM", "PBEAM": "BEAM", "PBEAML": "BEAM"}
LOADS = ("LOAD", "FORCE", "MOMENT", "GRAV", "PLOAD", "PLOAD1", "PLOAD2", "PLOAD4", "RFORCE", "TEMP", "TEMPD", "SPCD", "ACCEL", "ACCEL1")
ELEMENTS = {"triangle": "S3", "triangle6": "S6", "quad": "S4", "quad8": "S8", "line": "B31", "tet": "C3D4", "tet10": "C3D10"}
OWN_SYSTEM = "GRID with directions of its own"
MAY_HOLD = (
    "CBUSH", "CELAS1", "CELAS2", "CELAS3", "CELAS4", "CGAP", "CFAST", "CWELD", "RBAR", "RBE1", "RROD", "RSPLINE", "BCONP", "BCTABLE", OWN_SYSTEM,
)  # fmt: skip

# cards without which a deck is solved otherwise than it was meant; and real ones that one letter would make of these
_SPELT = (
    "GRID", "CTETRA", "CTRIA3", "CTRIA6", "CQUAD4", "CQUAD8", "CBAR", "CBEAM", "PSOLID", "PSHELL", "PBAR", "PBARL", "PBEAM", "PBEAML", "PCOMP",
    "MAT1", "SPC1", "SPCADD", "MPCADD", "RBE2", "RBE3", "FORCE", "MOMENT", "GRAV", "PLOAD4", "LOAD", "EIGRL", "EIGR", "PARAM", "ENDDATA",
)  # fmt: skip
_OTHERS = (
    "RBAR", "DLOAD", "PLOAD", "SLOAD", "CLOAD", "LOADT", "EGRID", "GRIDB", "GRIDF", "GRIDS", "CQUAD", "CTRIA", "CQUADR", "CTRIAR", "CQUADX", "CTRIAX",
    "CBARAO", "RBEAM", "PLOADX", "PSHEAR", "PCOMPG", "PCOMPS", "PCOMPP", "EIGB", "EIGC", "EIGP", "MATS1", "MATT1", "MATF1", "MATG1",
)  # fmt: skip


def cards_of_nastran(control: Sequence[str], bulk: Sequence[Fields], kinds: Sequence[str]) -> tuple[Card, ...]:
    """kinds : of the cells of the mesh in order."""
    cards = [_card("ELEMENT", {"TYPE": ELEMENTS[kind]}) for kind in kinds]
    cards += _materials(bulk)
    cards += [_card(fields[0], {}) for fields in bulk if fields[0] in MAY_HOLD]
    cards += [_card(OWN_SYSTEM, {}) for fields in bulk if fields[0] == "GRID" and len(fields) > 6 and fields[6] not in ("", "0")][:1]
    for fields in bulk:
        if fields[0] == "RBE2":
            rows = [(node, digit, digit) for node in fields[4:] if node.isdigit() for digit in fields[3]]
            cards.append(_card("KINEMATIC COUPLING", {"REF NODE": fields[2]}, rows))
        elif fields[0] == "RBE3":
            rows = [(node, digit, digit) for node in _averaged(fields[5:]) for digit in "123"]
            cards.append(_card("KINEMATIC COUPLING", {"REF NODE": fields[3]}, rows))
    steps, used = _steps(control, bulk)
    cards += [_card(MISSPELT, {"WORD": word, "MEANT": meant}) for word, meant in _misspelt(bulk)]
    return (*cards, *_equations(bulk, used), *steps)


def _misspelt(bulk: Sequence[Fields]) -> list[tuple[str, str]]:
    """(name, what it is one letter from) of cards that a solver stops at or passes over. A digit more or less makes another card."""
    words = dict.fromkeys(fields[0] for fields in bulk if fields[0] not in _SPELT and fields[0] not in _OTHERS)
    found = []
    for word in words:
        near = (name for name in _SPELT if re.sub(r"\D", "", name) == re.sub(r"\D", "", word) and is_near(word, name))
        found += [(word, meant) for meant in near][:1]
    return found


def _card(word: str, options: Mapping[str, str], data: Sequence[Fields] = ()) -> Card:
    return Card(word=word, options=dict(options), data=tuple(data))


def _materials(bulk: Sequence[Fields]) -> list[Card]:
    """Materials with what they have, sections, and elements whose property is not there as sections without a material."""
    cards = []
    for fields in bulk:
        if re.fullmatch(r"MAT\d+", fields[0]):
            has_density = fields[0] != "MAT1" or (len(fields) > 5 and fields[5] != "")
            cards.append(_card("MATERIAL", {"NAME": f"MAT_{fields[1]}"}))
            cards += [_card("ELASTIC", {}, _elastic(fields))] + ([_card("DENSITY", {})] if has_density else [])
    known = {fields[1]: fields for fields in bulk if fields[0] in SECTIONS}
    for name, fields in known.items():
        material = "" if fields[0] == "PCOMP" else fields[2]
        cards += [_card(f"{SECTIONS[fields[0]]} SECTION", {"MATERIAL": f"MAT_{material}", "PROPERTY": name})] if material else []
    elements = (fields for fields in bulk if fields[0] in ("CTETRA", "CBAR", "CBEAM") or fields[0].startswith(("CTRIA", "CQUAD")))
    asked = dict.fromkeys(fields[2] or fields[1] for fields in elements)
    return cards + [_card("SOLID SECTION", {"MATERIAL": f"OF PROPERTY {name}"}) for name in asked if name not in known]


def _elastic(fields: Fields) -> list[Fields]:
    """Young's modulus and Poisson's ratio of a MAT1, where both are given: one may follow from the shear modulus."""
    found = (*fields, "", "", "")[2:5]
    reals = [re.sub(r"(?<=[\d.])([+-]\d+)$", r"e\1", word) for word in (found[0], found[2])]  # 2.1+11
    return [(reals[0], reals[1])] if fields[0] == "MAT1" and all(reals) else []


def _averaged(words: Sequence[str]) -> list[str]:
    """Nodes of an RBE3, whose weights are reals, each with its unknowns behind it."""
    nodes: list[str] = []
    after_weight = False
    for word in words:
        if not word:
            continue
        if word in ("UM", "ALPHA"):
            break
        if "." in word:
            after_weight = True
        elif after_weight:
            after_weight = False
        else:
            nodes.append(word)
    return nodes


def _steps(control: Sequence[str], bulk: Sequence[Fields]) -> tuple[list[Card], set[str]]:
    """A step for each subcase, with the supports that it asks for; and the sets of MPC that are used."""
    solution = next((line.split()[1].rstrip(",") for line in control if line.startswith("SOL ")), "")
    releases = any(fields[:2] == ("PARAM", "INREL") and fields[2:] not in ((), ("0",)) for fields in bulk)
    cases: list[dict[str, str]] = [{}]
    for line in control:
        if line.startswith("SUBCASE"):
            cases.append(dict(cases[0]))
        elif match := re.match(r"(SPC|MPC|LOAD)\s*=\s*(\d+)", line):
            cases[-1][match[1]] = match[2]
    kept = [rows for fields in bulk if fields[0] == "GRID" and len(fields) > 7 for rows in [(fields[1], digit, digit) for digit in fields[7]]]
    cards = []
    for case in (cases[1:] or cases) if solution else []:
        held = [*kept, *(_held(case["SPC"], bulk) if "SPC" in case else [])]
        cards += [_card("STEP", {}), _card(SOLUTIONS.get(solution, "DYNAMIC"), {})]
        cards += [_card("INERTIA RELIEF", {})] if releases else []
        cards += [_card("BOUNDARY", {"OP": "NEW"}, held), *_loads(case, bulk), _card("END STEP", {})]
    return cards, {case["MPC"] for case in cases if "MPC" in case}


def _held(number: str, bulk: Sequence[Fields]) -> list[Fields]:
    """Rows (node, unknown, unknown) of a set of supports; a name where there is none."""
    sets = {number, *(word for fields in bulk if fields[0] == "SPCADD" and fields[1] == number for word in fields[2:])}
    rows: list[Fields] = []
    found = False
    for fields in bulk:
        if fields[0] == "SPC1" and fields[1] in sets:
            found, words = True, [word for word in fields[3:] if word]
            spans = len(words) == 3 and words[1].upper() == "THRU"
            nodes = map(str, range(int(words[0]), int(words[2]) + 1)) if spans else iter(words)
            rows += [(node, digit, digit) for node in nodes for digit in fields[2]]
        elif fields[0] == "SPC" and fields[1] in sets:
            found = True
            pairs = [fields[k : k + 2] for k in (2, 5) if len(fields) > k + 1]
            rows += [(node, digit, digit) for node, unknowns in pairs for digit in unknowns]
    return rows if found else [(f"SPC_{number}", "1", "6")]


def _loads(case: Mapping[str, str], bulk: Sequence[Fields]) -> list[Card]:
    if "LOAD" not in case:
        return []
    sets = {case["LOAD"], *(word for fields in bulk if fields[0] == "LOAD" and fields[1] == case["LOAD"] for word in fields[4::2])}
    own = [fields for fields in bulk if fields[0] in LOADS and fields[1] in sets]
    heavy = [_card("DLOAD", {}, [("", "GRAV")]) for fields in own if fields[0] in ("GRAV", "ACCEL", "RFORCE")][:1]
    nodes = [(fields[2],) for fields in own if fields[0] in ("FORCE", "MOMENT") and len(fields) > 2]
    return [*heavy, *([_card("CLOAD", {}, nodes)] if nodes else [])] if own else [_card("CLOAD", {}, [(f"LOAD_{case['LOAD']}",)])]


def _equations(bulk: Sequence[Fields], used: set[str]) -> list[Card]:
    sets = used | {word for fields in bulk if fields[0] == "MPCADD" and fields[1] in used for word in fields[2:]}
    cards = []
    for fields in bulk:
        if fields[0] == "MPC" and fields[1] in sets:
            # two terms a line, a field left empty before each further line
            words = [fields[k : k + 3] for line in range(2, len(fields), 8) for k in (line, line + 3) if len(fields) > k + 1 and fields[k]]
            terms = [(node, unknown or "1", factor.rstrip(".") + "." if factor.isdigit() else factor) for node, unknown, factor in words]
            cards.append(_card("EQUATION", {}, [(str(len(terms)),), *terms]))
    return cards
