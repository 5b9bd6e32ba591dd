"""What the [[object]] tables mean: sections and dimensions, and the object of the scene that each belongs to."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from scan2fea.cad.nominal import read_nominal
from scan2fea.errors import EstimationError, UsageError, require
from scan2fea.estimation.designation import parse_designation
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.table import Table
from scan2fea.io.files import existing_file
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import volume
from scan2fea.kernel.outline import outline_area, outline_of
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.pipeline.known import KnownObject
from scan2fea.pipeline.route import KnownSection
from scan2fea.types import FloatArray, Member, PointCloud, Scan

NOMINAL_POINTS = 8_000  # drawn from a nominal part: exact points, the fit is then good to micrometres
NOMINAL_VOLUME = 0.05  # what fillets may add to the section without; more is a part that is no member


def resolved(objects: Sequence[KnownObject], table: Table | None, seed: int) -> tuple[KnownObject, ...]:
    """The tables with designations and nominal parts turned into families and dimensions; a drawing of no member is compared, and no more.

    Raises UsageError for what names no section or contradicts itself; InputError for a STEP file that cannot be read.
    """
    return tuple(_resolved(known, number, table, seed) for number, known in enumerate(objects, start=1))


def _resolved(known: KnownObject, number: int, table: Table | None, seed: int) -> KnownObject:
    where = f"[[object]] table {number}"
    family, fixed, nominal = known.family, dict(known.fixed), dict(known.nominal)
    if known.member or known.step:
        given = parse_designation(known.member, table) if known.member else None
        try:
            own, sizes = (given.family, dict(given.parameters)) if given is not None else _of_nominal(Path(known.step), seed)
        except EstimationError as error:
            require(not (family or fixed or nominal), UsageError, str(error))
            return known
        require(family in ("", own), UsageError, f"{where}: family = {family!r}, but {known.member or known.step} is of family {own}")
        length = sizes.pop("length", None)
        twice = [name for name in sizes if name in fixed]
        require(not twice, UsageError, f"{where}: {', '.join(twice)} given twice, in fixed and by {known.member or known.step}")
        family, fixed = own, {**sizes, **fixed}
        nominal = {**({} if length is None or "length" in fixed else {"length": length}), **nominal}
    for name in [*fixed, *nominal]:
        of = PARAMETERS.get(family)
        require(of is None or name in (*of, "length"), UsageError, f"{where}: a member of family {family} has no dimension {name!r}")
    return dataclasses.replace(known, member="", family=family, fixed=fixed, nominal=nominal)


def _of_nominal(path: Path, seed: int) -> tuple[str, dict[str, float]]:
    """Family and dimensions, length included, of a part drawn as a solid: fitted to exact points of its surface. Raises EstimationError where it is
    no member.
    """
    existing_file(path)
    mesh = read_nominal(path)
    points = sample_surface(mesh, NOMINAL_POINTS, seed)[0]
    no_member = f"{path}: the nominal part is no straight member of {', '.join(PARAMETERS)}"
    try:
        found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions(seed=seed))
    except EstimationError as error:
        raise EstimationError(f"{no_member}: {error}") from error
    require(found.explains, EstimationError, f"{no_member}: {found.reason}")
    return found.member.family, _same_volume(found.member, volume(mesh), no_member)


def _same_volume(member: Member, drawn_m3: float, no_member: str) -> dict[str, float]:
    values = member.values()
    made = outline_area(outline_of(member)) * values["length"]
    says = f"{no_member}: it encloses {drawn_m3:.6g} m3, the likeliest member {made:.6g} m3"
    require(abs(made - drawn_m3) <= NOMINAL_VOLUME * drawn_m3, EstimationError, says)
    return values


def assigned(known: Sequence[KnownObject], objects: Mapping[int, FloatArray], shift_m: FloatArray) -> tuple[KnownObject, ...]:
    """Each table with the id of the object it belongs to.

    objects : id -> (n, 3) points, shifted by -shift_m.   Raises UsageError where there is no such object, none near the place that is meant, or
    two tables for one.
    """
    out: dict[int, KnownObject] = {}
    for number, one in enumerate(known, start=1):
        where = f"[[object]] table {number}"
        require(len(objects) > 0, UsageError, f"{where}: the scene has no objects")
        found = one.id if one.id is not None else _nearest(np.asarray(one.at, float) - shift_m, objects, where)
        listed = f"it has {len(objects)}: {', '.join(str(i) for i in sorted(objects))}"
        require(found in objects, UsageError, f"{where}: the scene has no object {found}; {listed}")
        require(found not in out, UsageError, f"{where}: object {found} has a table already")
        out[found] = dataclasses.replace(one, id=found, at=None)
    return tuple(out[i] for i in sorted(out))


def _nearest(place: FloatArray, objects: Mapping[int, FloatArray], where: str) -> int:
    """The object whose centre (of its box) is nearest; a place further off than the object is large means none."""
    boxes = {i: (points.min(axis=0), points.max(axis=0)) for i, points in objects.items()}
    away = {i: float(np.linalg.norm(place - (low + high) / 2)) for i, (low, high) in boxes.items()}
    found = min(away, key=lambda i: (away[i], i))
    size = float(np.linalg.norm(boxes[found][1] - boxes[found][0]))
    says = f"{where}: at lies {away[found]:.3g} m from the centre of the nearest object ({found}), which is {size:.3g} m large: no object is there"
    require(away[found] <= size, UsageError, says)
    return found


def own_section(objects: Sequence[KnownObject], object_id: int) -> KnownSection | None:
    """What resolved tables say of an object; None where they say nothing of it."""
    for known in objects:
        if known.id == object_id:
            return KnownSection(family=known.family, fixed=known.fixed, nominal=known.nominal, whole=known.whole)
    return None
