"""The surface where nobody says from where the points were seen: answers to "which side is outside" are tried until one passes every gate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.delaunay import Tetrahedralisation
from scan2fea.reconstruction.bores import Bore
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.carve import Carved, carve
from scan2fea.reconstruction.evidence import BY_FLOOD, BY_NORMALS, Ends
from scan2fea.reconstruction.flooding import Setting
from scan2fea.reconstruction.gates import Evidence, Unseen, failed, gates_unseen
from scan2fea.reconstruction.gates_outside import GAPS_ENTERED
from scan2fea.reconstruction.lost_bores import WHOLE, Told, closed_bores, facing_axis, in_bores, told_by
from scan2fea.reconstruction.outside import Flood, OutsideOptions, entered, floods, prepare
from scan2fea.reconstruction.wall_ends import unseen_ends
from scan2fea.reconstruction.winding import fitted, plain_areas, polish
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, Value

LEAST_GIVEN = 0.5  # share of the points that must have a normal for the normals to lead
FLOOD_SOURCE = 2.0  # votes of a tet the ball reaches among the denoised points
BY_BORES = ("points afloat inside", "stray points")  # what points on the walls of bores that are closed fail
BALL_AGAIN = 1.1  # the ball that rolls among the denoised points, against the first


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer(Value):
    """One surface, the answer it rests on, and what the gates say of it.

    flood : None where the normals of the file told the outside.   told : what its points tell besides, where that was asked.
    """

    carved: Carved
    evidence: Evidence
    flood: Flood | None
    checks: tuple[Check, ...]
    n_tried: int
    told: Told | None = None

    @property
    def source(self) -> str:
        return BY_NORMALS if self.flood is None else BY_FLOOD


@dataclass(frozen=True, eq=False, kw_only=True)
class _Asked(Value):
    """What every answer is asked on, as in `unseen`."""

    points: FloatArray
    is_inferred: BoolArray | None
    n_hidden: int
    sensors: FloatArray | None
    ends: tuple[Ends, ...]
    frame: IntArray | None
    spacing_m: float
    quality_weight: float
    seed: int


def unseen(
    points: FloatArray,
    is_inferred: BoolArray | None,
    options: OutsideOptions,
    quality_weight: float,
    n_hidden: int = 0,
    sensors: FloatArray | None = None,
    ends: tuple[Ends, ...] = (),
    frame: IntArray | None = None,
    normals: FloatArray | None = None,
) -> Answer:
    """The first answer that passes all gates, else the one that fails the fewest. Raises ReconstructionError if none gives a surface.

    n_hidden : of the last points, that stand for places no ray has reached.   sensors : (n, 3) of points whose sight lines stood the test though they
    were too few to lead, nan rows where not known: they only tell what is empty beyond the ends of walls.   ends : of walls that other answers had.
    frame : (n,) the scan each point came from, negative for none.   normals : (n, 3) of the file, zero or nan rows where not known, or None: asked
    where no ball gives an answer that passes.
    """
    setting = prepare(points, options.seed)
    asked = _Asked(
        points=points,
        is_inferred=is_inferred,
        n_hidden=n_hidden,
        sensors=sensors,
        ends=ends,
        frame=frame,
        spacing_m=setting.spacing_m,
        quality_weight=quality_weight,
        seed=options.seed,
    )
    best: Answer | None = None
    reason = "the rolling ball gives no answer"
    n = 0
    for n, flood in enumerate(floods(setting, options), start=1):
        try:
            answer = _answer(asked, flood.signed, flood, n)
        except ReconstructionError as error:
            reason = str(error)
            continue
        if best is None or len(failed(answer.checks)) < len(failed(best.checks)):
            best = answer
        if {check.name for check in failed(answer.checks)} <= {GAPS_ENTERED}:
            break
        if WALL_ENDS in (check.name for check in failed(answer.checks)):  # the next answer may miss them by chance: it is the same scan
            asked = replace(asked, ends=(*asked.ends, unseen_ends(answer.evidence)))
    if best is None:
        raise ReconstructionError(f"no surface in {n} attempts without sensor positions ({reason}): give the sensor position")
    given = None if normals is None or not failed(best.checks) else _by_normals(asked, normals, n + 1)
    if given is not None and len(failed(given.checks)) < len(failed(best.checks)):
        best = given
    return _with_bores(asked, best) if {check.name for check in failed(best.checks)} <= {GAPS_ENTERED, *BY_BORES} else best


def _by_normals(asked: _Asked, normals: FloatArray, n: int) -> Answer | None:
    """The answer by the normals of the file; None where too few points have one or nothing is inside.

    Which side they call outside is told by the volume they enclose: normals that all look inwards are turned.
    """
    length = np.linalg.norm(np.nan_to_num(normals), axis=1)
    known = length > 0.0
    if known.mean() < LEAST_GIVEN:
        return None
    outward = np.where(known[:, None], np.nan_to_num(normals) / np.where(known, length, 1.0)[:, None], 0.0)
    enclosed = np.einsum("n,nc,nc->", plain_areas(asked.points), asked.points - asked.points.mean(axis=0), outward)
    try:
        return _answer(asked, outward if enclosed >= 0.0 else -outward, None, n)
    except ReconstructionError:  # the ball's answer is one, and says what is against it
        return None


def _with_bores(asked: _Asked, found: Answer) -> Answer:
    """The answer again with bores open that no ball enters and whose walls were scanned; that which was found where none is closed."""
    told = told_by(asked.points, found.evidence.normals, asked.spacing_m, found.evidence.sigma_m)
    found, bores = replace(found, told=told), told.bores
    if closed_bores(bores, found.carved.mesh).passed:
        return found
    try:
        again = _answer(asked, found.evidence.normals if found.flood is None else found.flood.signed, found.flood, found.n_tried, tuple(bores))
    except ReconstructionError:  # the first surface is one, and is told to close them
        return found
    opened = closed_bores(bores, again.carved.mesh).passed and len(failed(again.checks)) <= len(failed(found.checks))
    return again if opened else found


def _answer(asked: _Asked, signed: FloatArray, flood: Flood | None, n: int, bores: tuple[Bore, ...] = ()) -> Answer:
    """signed : (n, 3) outward as it was told, zero rows where not.   flood : that told it; None: the normals of the file, and nothing else."""
    points, spacing_m = asked.points, asked.spacing_m
    polished = polish(points, signed, spacing_m)
    outward = polished if flood is not None else np.where(np.any(signed, axis=1, keepdims=True), signed, polished)
    normals, sigma, between = fitted(points, outward, spacing_m, asked.frame)
    for bore in bores:
        normals = facing_axis(bore, points, normals, spacing_m, sigma)

    open_space: list[BoolArray] = []

    def prior(tetra: Tetrahedralisation) -> FloatArray:
        reached = np.zeros(len(tetra), bool)
        if flood is not None:
            reached = entered(Setting.of(tetra, normals, spacing_m), BALL_AGAIN * flood.ball_m, flood)
        open_space.append(reached)
        return np.where(reached | in_bores(bores, tetra), FLOOD_SOURCE, 0.0)

    blind = np.full_like(points, np.nan)
    carved = carve(
        points, normals, blind, spacing_m, sigma, between_m=between, prior=prior, quality_weight=asked.quality_weight, seed=asked.seed,
        kept=partial(in_bores, bores, share=WHOLE),
    )  # fmt: skip
    evidence = Evidence(
        points=points,
        mesh=carved.mesh,
        smoothed=carved.clean.points,
        normals=carved.clean.normals,
        thickness_m=carved.thickness_m,
        gap_m=carved.gap_m,
        spacing_m=spacing_m,
        sigma_m=sigma,
        is_inferred=asked.is_inferred,
        n_hidden=asked.n_hidden,
        sensors=asked.sensors,
        ends_before=asked.ends,
        frame=asked.frame,
        between_m=between,
    )
    volumes = carved.tetra.volumes
    share = float(volumes[open_space[-1] & carved.inside].sum() / volumes[carved.inside].sum())
    facts = Unseen(signed=signed, flood=flood, polished=polished, held=carved.labels.held, flood_inside=share)
    return Answer(carved=carved, evidence=evidence, flood=flood, checks=gates_unseen(evidence, facts), n_tried=n)
