"""STEP AP214 text of a solid of plane faces (ISO 10303-21 and -214), written entity by entity.

Written here and not by Open Cascade because the text is then the same on every run (no date, no session counters), holds the faces by name and in
their order, and a body of 16 000 facets takes a second. Open Cascade reads it back before anybody else does (readback.py).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from scan2fea.cad.patchwork import Patchwork, PlaneFace
from scan2fea.errors import CadError, require
from scan2fea.types import FloatArray
from scan2fea.units import MILLIMETRES_PER_METRE

HEADER = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION(('{description}'),'2;1');
FILE_NAME('{name}','1970-01-01T00:00:00',(''),(''),'scan2fea','scan2fea','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN {{ 1 0 10303 214 1 1 1 1 }}'));
ENDSEC;
DATA;
"""
FOOTER = "ENDSEC;\nEND-ISO-10303-21;\n"
PRODUCT_NAME = "SOLID"  # of one object's file; an assembly gives each its own

# numbers below that assembly.py refers to when it joins several files
DEFINITION, REPRESENTATION, PLACEMENT, SOLID, CONTEXT = 5, 10, 11, 15, 16
HEAD = """#1=APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#2);
#2=APPLICATION_CONTEXT('core data for automotive mechanical design processes');
#3=SHAPE_DEFINITION_REPRESENTATION(#4,#10);
#4=PRODUCT_DEFINITION_SHAPE('','',#5);
#5=PRODUCT_DEFINITION('design','',#6,#9);
#6=PRODUCT_DEFINITION_FORMATION('','',#7);
#7=PRODUCT('{name}','{name}','',(#8));
#8=PRODUCT_CONTEXT('',#2,'mechanical');
#9=PRODUCT_DEFINITION_CONTEXT('part definition',#2,'design');
#10=ADVANCED_BREP_SHAPE_REPRESENTATION('{name}',(#11,#15),#16);
#11=AXIS2_PLACEMENT_3D('',#12,#13,#14);
#12=CARTESIAN_POINT('',(0.,0.,0.));
#13=DIRECTION('',(0.,0.,1.));
#14=DIRECTION('',(1.,0.,0.));
#15=MANIFOLD_SOLID_BREP('{name}',#22);
#16=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#20))GLOBAL_UNIT_ASSIGNED_CONTEXT((#17,#18,#19))REPRESENTATION_CONTEXT('','3D'));
#17=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#18=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#19=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#20=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE({uncertainty}),#17,'distance_accuracy_value','confusion accuracy');
#21=PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,(#7));
"""
FIRST_FREE = 23


def real(value: float) -> str:
    """A REAL of ISO 10303-21: the shortest digits that give the same double back, always with a decimal point."""
    text = repr(float(value))
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.'}E{int(exponent)}"


def _triple(values: Iterable[float]) -> str:
    return "(" + ",".join(real(v) for v in values) + ")"


class _Writer:
    """Entities in order of writing; equal directions and points are written once."""

    def __init__(self, points_mm: FloatArray) -> None:
        self.lines: list[str] = []
        self.next = FIRST_FREE
        self.points_mm = points_mm
        self.point: dict[int, int] = {}
        self.vertex: dict[int, int] = {}
        self.edge: dict[tuple[int, int], int] = {}
        self.uses: dict[tuple[int, int], int] = {}
        self.known: dict[str, int] = {}

    def add(self, text: str) -> int:
        number = self.next
        self.lines.append(f"#{number}={text};\n")
        self.next = number + 1
        return number

    def once(self, text: str) -> int:
        if text not in self.known:
            self.known[text] = self.add(text)
        return self.known[text]

    def direction(self, vector: FloatArray) -> int:
        unit = vector / np.sqrt(vector @ vector) + 0.0  # + 0.0: no "-0.0"
        return self.once(f"DIRECTION('',{_triple(unit.tolist())})")

    def vertex_point(self, v: int) -> int:
        if v not in self.vertex:
            self.point[v] = self.add(f"CARTESIAN_POINT('',{_triple(self.points_mm[v].tolist())})")
            self.vertex[v] = self.add(f"VERTEX_POINT('',#{self.point[v]})")
        return self.vertex[v]

    def oriented_edge(self, tail: int, head: int) -> int:
        """The edge as this wire runs along it; the other wire gets the same EDGE_CURVE, the other way round."""
        a, b = self.vertex_point(tail), self.vertex_point(head)
        if (head, tail) in self.edge:
            number, sense = self.edge[head, tail], "F"
        else:
            require((tail, head) not in self.edge, CadError, "two wires run the same way along an edge: the surface is not oriented; repair it")
            along = self.direction(self.points_mm[head] - self.points_mm[tail])
            vector = self.once(f"VECTOR('',#{along},1.)")
            line = self.add(f"LINE('',#{self.point[tail]},#{vector})")
            number, sense = self.add(f"EDGE_CURVE('',#{a},#{b},#{line},.T.)"), "T"
            self.edge[tail, head] = number
        key = (min(tail, head), max(tail, head))
        self.uses[key] = self.uses.get(key, 0) + 1
        return self.add(f"ORIENTED_EDGE('',*,*,#{number},.{sense}.)")

    def face(self, face: PlaneFace, name: str, point_mm: FloatArray) -> int:
        bounds = []
        for k, wire in enumerate(face.wires):
            edges = [self.oriented_edge(u, v) for u, v in zip(wire, (*wire[1:], wire[0]), strict=True)]
            loop = self.add(f"EDGE_LOOP('',({','.join(f'#{e}' for e in edges)}))")
            bounds.append(self.add(f"{'FACE_BOUND' if k else 'FACE_OUTER_BOUND'}('',#{loop},.T.)"))
        outer = face.wires[0]
        along = self.points_mm[outer[1]] - self.points_mm[outer[0]]
        along = along - (along @ face.normal) * face.normal
        if face.region < 0:
            origin = self.point[outer[0]]
        else:
            origin = self.add(f"CARTESIAN_POINT('',{_triple(point_mm.tolist())})")
        frame = self.add(f"AXIS2_PLACEMENT_3D('',#{origin},#{self.direction(face.normal)},#{self.direction(along)})")
        plane = self.add(f"PLANE('',#{frame})")
        return self.add(f"ADVANCED_FACE('{name}',({','.join(f'#{b}' for b in bounds)}),#{plane},.T.)")


def step_text(patches: Patchwork, names: tuple[str, ...], uncertainty_m: float) -> str:
    """The file. `uncertainty_m`: how far vertices may lie off their planes (the tolerance that readers give the edges). Raises CadError."""
    writer = _Writer(patches.vertices * MILLIMETRES_PER_METRE)
    numbers = [writer.face(face, name, face.point * MILLIMETRES_PER_METRE) for face, name in zip(patches.faces, names, strict=True)]
    odd = sum(1 for n in writer.uses.values() if n != 2)
    require(odd == 0, CadError, f"{odd} edges of the solid are not shared by exactly two faces: the surface is not closed; repair it first")
    shell = f"#22=CLOSED_SHELL('',({','.join(f'#{n}' for n in numbers)}));\n"
    head = HEAD.format(name=PRODUCT_NAME, uncertainty=real(uncertainty_m * MILLIMETRES_PER_METRE))
    return HEADER.format(description="scan2fea solid", name="model.step") + head + shell + "".join(writer.lines) + FOOTER
