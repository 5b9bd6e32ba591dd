"""Several solids in one STEP file: each a part with its name and colour under one assembly (AP214)."""

from __future__ import annotations

import re
from collections.abc import Sequence

from scan2fea.cad.step_text import CONTEXT, DEFINITION, FOOTER, HEADER, PLACEMENT, PRODUCT_NAME, REPRESENTATION, SOLID, real
from scan2fea.errors import CadError, require
from scan2fea.types import Brep

Colour = tuple[float, float, float]
_REFERENCE = re.compile(r"#(\d+)")
_ROOT = """#1=APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#2);
#2=APPLICATION_CONTEXT('core data for automotive mechanical design processes');
#3=SHAPE_DEFINITION_REPRESENTATION(#4,#10);
#4=PRODUCT_DEFINITION_SHAPE('','',#5);
#5=PRODUCT_DEFINITION('design','',#6,#9);
#6=PRODUCT_DEFINITION_FORMATION('','',#7);
#7=PRODUCT('ASSEMBLY','ASSEMBLY','',(#8));
#8=PRODUCT_CONTEXT('',#2,'mechanical');
#9=PRODUCT_DEFINITION_CONTEXT('part definition',#2,'design');
#11=AXIS2_PLACEMENT_3D('',#12,#13,#14);
#12=CARTESIAN_POINT('',(0.,0.,0.));
#13=DIRECTION('',(0.,0.,1.));
#14=DIRECTION('',(1.,0.,0.));
#16=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#20))GLOBAL_UNIT_ASSIGNED_CONTEXT((#17,#18,#19))REPRESENTATION_CONTEXT('','3D'));
#17=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#18=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#19=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#20=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),#17,'distance_accuracy_value','confusion accuracy');
"""
_ROOT_END = 21


def assembly(breps: Sequence[Brep], names: Sequence[str], colours: Sequence[Colour] | None = None) -> str:
    """STEP text of all solids where they are, each a named part; colours are red, green, blue from 0 to 1.

    Raises CadError where there is nothing to write, lengths differ, or a B-Rep was not written by `to_brep`.
    """
    require(len(breps) > 0, CadError, "an assembly needs at least one solid")
    require(len(breps) == len(names), CadError, f"{len(breps)} solids, but {len(names)} names")
    require(colours is None or len(colours) == len(breps), CadError, f"{len(breps)} solids, but another number of colours")
    chunks, placements, free = [_ROOT], [], _ROOT_END
    for k, (brep, name) in enumerate(zip(breps, names, strict=True)):
        shift = free
        data, last = _shifted(brep.step, shift, _text(name))
        links, placement, free = _links(shift, last + 1, k + 1, _text(name))
        chunks += [data, links]
        placements.append(placement)
        if colours is not None:
            style, free = _style(shift, free, colours[k])
            chunks.append(style)
    items = ",".join(f"#{n}" for n in (PLACEMENT, *placements))
    chunks.append(f"#{REPRESENTATION}=SHAPE_REPRESENTATION('ASSEMBLY',({items}),#{CONTEXT});\n")
    return HEADER.format(description="scan2fea assembly", name="assembly.step") + "".join(chunks) + FOOTER


def _text(name: str) -> str:
    """A STRING of ISO 10303-21: printable ASCII, quotes and backslashes doubled; anything else as X2 escapes."""
    wide = "".join(c if " " <= c <= "~" else "\\X2\\" + c.encode("utf-16-be").hex().upper() + "\\X0\\" for c in name.replace("\\", "\\\\"))
    return wide.replace("'", "''")


def _shifted(step: str, shift: int, name: str) -> tuple[str, int]:
    """The DATA section with all numbers raised by `shift` and the part named; and its largest number."""
    require("DATA;\n" in step and f"PRODUCT('{PRODUCT_NAME}'" in step, CadError, "the B-Rep holds STEP text that to_brep did not write")
    data = step[step.index("DATA;\n") + 6 : step.rindex("ENDSEC;")]
    last = 0

    def raised(match: re.Match[str]) -> str:
        nonlocal last
        number = int(match[1]) + shift
        last = max(last, number)
        return f"#{number}"

    return _REFERENCE.sub(raised, data).replace(f"'{PRODUCT_NAME}'", f"'{name}'"), last


def _links(shift: int, free: int, occurrence: int, name: str) -> tuple[str, int, int]:
    """The occurrence of a part in the assembly, in its own place (the identity). Returns text, its placement and the next free number."""
    use, shape, place, relation, transform, where = range(free, free + 6)
    text = (
        f"#{use}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('{occurrence}','{name}','',#{DEFINITION},#{shift + DEFINITION},$);\n"
        f"#{shape}=PRODUCT_DEFINITION_SHAPE('Placement','Placement of an item',#{use});\n"
        f"#{place}=AXIS2_PLACEMENT_3D('',#12,#13,#14);\n"
        f"#{relation}=(REPRESENTATION_RELATIONSHIP('','',#{shift + REPRESENTATION},#{REPRESENTATION})"
        f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{transform})SHAPE_REPRESENTATION_RELATIONSHIP());\n"
        f"#{transform}=ITEM_DEFINED_TRANSFORMATION('','',#{shift + PLACEMENT},#{place});\n"
        f"#{where}=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relation},#{shape});\n"
    )
    return text, place, free + 6


def _style(shift: int, free: int, colour: Colour) -> tuple[str, int]:
    """The colour of a part's solid."""
    require(all(0 <= c <= 1 for c in colour), CadError, f"colour {tuple(colour)}: red, green and blue go from 0 to 1")
    red, green, blue = (real(c) for c in colour)
    chain = (
        f"COLOUR_RGB('',{red},{green},{blue})",
        "FILL_AREA_STYLE_COLOUR('',#{})",
        "FILL_AREA_STYLE('',(#{}))",
        "SURFACE_STYLE_FILL_AREA(#{})",
        "SURFACE_SIDE_STYLE('',(#{}))",
        "SURFACE_STYLE_USAGE(.BOTH.,#{})",
        "PRESENTATION_STYLE_ASSIGNMENT((#{}))",
        f"STYLED_ITEM('color',(#{{}}),#{shift + SOLID})",
        f"MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',(#{{}}),#{shift + CONTEXT})",
    )
    lines = [f"#{free + k}={entity.format(free + k - 1)};\n" for k, entity in enumerate(chain)]
    return "".join(lines), free + len(chain)
