"""STEP text of a shape of Open Cascade in the form of the other files: its own head, fixed dates, faces by name and in the order of the shell."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scan2fea.cad.live import silence
from scan2fea.cad.step_text import FIRST_FREE, FOOTER, HEAD, HEADER, PRODUCT_NAME, real
from scan2fea.errors import CadError, require
from scan2fea.units import MILLIMETRES_PER_METRE

_ENTITY = re.compile(r"#(\d+)\s*=\s*(.*?);\s*(?=#\d+\s*=|ENDSEC)", re.DOTALL)
_REFERENCE = re.compile(r"#(\d+)")
_SHELL = 22  # number of the shell in HEAD


def step_of_solid(solid: Any, uncertainty_m: float) -> tuple[str, list[int]]:
    """The text with faces still without names, and the numbers of its ADVANCED_FACE entities in the order of the shell. Raises CadError."""
    entities = _entities(_written(solid))
    shells = [number for number, text in entities.items() if text.startswith("CLOSED_SHELL")]
    require(len(shells) == 1, CadError, f"the solid has {len(shells)} closed shells instead of one")
    reached, front = {shells[0]}, [shells[0]]
    while front:
        for found in _REFERENCE.findall(entities[front.pop()]):
            if int(found) not in reached:
                reached.add(int(found))
                front.append(int(found))
    rest = sorted(reached - {shells[0]})
    number = {old: FIRST_FREE + k for k, old in enumerate(rest)} | {shells[0]: _SHELL}

    def line(old: int) -> str:
        return f"#{number[old]}={_REFERENCE.sub(lambda m: f'#{number[int(m[1])]}', entities[old])};\n"

    faces = [number[int(k)] for k in _REFERENCE.findall(entities[shells[0]])]
    head = HEAD.format(name=PRODUCT_NAME, uncertainty=real(uncertainty_m * MILLIMETRES_PER_METRE))
    text = HEADER.format(description="scan2fea solid", name="model.step") + head + "".join(line(k) for k in (shells[0], *rest)) + FOOTER
    return text, faces


def named(step: str, faces: Sequence[int], names: Sequence[str]) -> str:
    """The text with a name on each face."""
    name_of = dict(zip(faces, names, strict=True))

    def renamed(match: re.Match[str]) -> str:
        return f"#{match[1]}=ADVANCED_FACE('{name_of.get(int(match[1]), '')}',"

    return re.sub(r"#(\d+)=ADVANCED_FACE\('[^']*',", renamed, step)


def _entities(step: str) -> dict[int, str]:
    data = step[step.index("DATA;") + 5 :]
    return {int(m[1]): re.sub(r"\s*\n\s*", "", m[2]) for m in _ENTITY.finditer(data)}


def _written(solid: Any) -> str:
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    silence()
    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    Interface_Static.SetIVal_s("write.precision.mode", 0)
    require(writer.Transfer(solid, STEPControl_AsIs) == IFSelect_RetDone, CadError, "Open Cascade cannot write the solid as STEP")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solid.step"
        require(writer.Write(str(path)) == IFSelect_RetDone, CadError, "Open Cascade cannot write the solid as STEP")
        return path.read_text(encoding="ascii")
