"""Which segments are worth modelling. What is left out stays in the cloud, with its label and the reason."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.segmentation.furnishing import KINDS as FURNITURE
from scan2fea.segmentation.furnishing import furnishing
from scan2fea.segmentation.kinds import OBJECT_KINDS, SUPPORT_KINDS, UNKNOWN
from scan2fea.segmentation.options import SelectOptions
from scan2fea.types import FloatArray, PointCloud, Segments

ROLES = ("object", "support", "clutter")
MEMBER = "member"  # among select.kinds: every object that is slender, whatever it is guessed to be
KINDS = (*ROLES, MEMBER, *(kind for kind in OBJECT_KINDS if kind not in ROLES), *SUPPORT_KINDS, UNKNOWN)
_ROLE_SAYS = {"support": "a support, which carries or bounds the rest", "clutter": "clutter, a leftover of a support"}
_FURNITURE = "a box or heap that stands free on the floor of a scene of members (select.furnishing = true models it)"
_SLENDER = 3.0  # length over the larger side of the section: EN 1992-1-1, 5.3.1
_TAIL = 0.01
_KIND_SAYS = {"floor": "a floor, which carries the rest", "wall": "a wall, which bounds the rest"}


@dataclass(frozen=True, kw_only=True)
class Selection:
    """labels : of the objects to model, largest first, ties by the first point.   notes : one sentence per segment left out, or per group of them.

    why : label -> why it is modelled or is not, in a few words.
    """

    labels: tuple[int, ...]
    notes: tuple[str, ...]
    why: Mapping[int, str] = field(default_factory=dict)


def select(
    cloud: PointCloud, segments: Segments, options: SelectOptions = SelectOptions(), given: Collection[int] = (), names: Sequence[str] = ()
) -> Selection:
    """The segments of the wanted kinds that have enough points, largest first.

    names : kind of each segment (I, pipe, floor, ...) beside its role; empty: not known.

    given : labels of segments that came with faces: of those no number of points is too few, for the vertices of a mesh do not tell its size.
    The order depends on the points alone: by number of points, descending, then by the first point. Places are in the frame of the cloud.
    Raises UsageError for a label or a kind that does not exist.
    """
    n = len(segments.kinds)
    counts = np.bincount(segments.labels[segments.labels >= 0], minlength=n)
    first = np.full(n, len(cloud))
    np.minimum.at(first, segments.labels[segments.labels >= 0], np.flatnonzero(segments.labels >= 0))
    order = sorted((label for label in range(n) if counts[label]), key=lambda label: (-counts[label], first[label]))
    says = f"select.labels {list(options.labels)}: the scene has the labels 0 to {n - 1}, see labels.csv"
    require(all(0 <= label < n for label in options.labels), UsageError, says)
    left_out: dict[str, list[int]] = {}
    if options.labels:
        wanted = _keep(order, lambda label: label in options.labels, "not among select.labels", left_out)
    else:
        slender = frozenset(_slender(cloud, segments)) if MEMBER in options.kinds else frozenset()
        wanted = _of_kinds(order, segments.kinds, names or segments.kinds, options.kinds, left_out, slender)
        spared = _furniture(cloud, segments, options, names, given)
        wanted = _keep(wanted, lambda label: label not in spared, _FURNITURE, left_out)
    wanted = _by_place(cloud, segments, options, wanted, left_out)
    least = max(float(options.min_points), options.min_share * max((counts[label] for label in wanted), default=0))
    few = f"with fewer than {round(least)} points (select.min_points, select.min_share)"
    chosen = _keep(wanted, lambda label: bool(counts[label] >= least or label in given), few, left_out)
    left_out[f"beyond select.max_objects = {options.max_objects}"] = chosen[options.max_objects :]
    why = {label: f"not modelled: {reason}" for reason, labels in left_out.items() for label in labels}
    labels = tuple(chosen[: options.max_objects])
    why |= {label: f"to be modelled: object {number}" for number, label in enumerate(labels, start=1)}
    notes = (_note(labels, reason) for reason, labels in left_out.items())
    return Selection(labels=labels, notes=tuple(note for note in notes if note), why=why)


def _keep(labels: list[int], wanted: Callable[[int], bool], why_not: str, left_out: dict[str, list[int]]) -> list[int]:
    """The wanted labels; the others are entered in `left_out` under the reason."""
    left_out[why_not] = [label for label in labels if not wanted(label)]
    return [label for label in labels if wanted(label)]


def _furniture(cloud: PointCloud, segments: Segments, options: SelectOptions, names: Sequence[str], given: Collection[int]) -> list[int]:
    """Labels that are left out as furniture: none where the user has picked by place or kind, or has edited the labels."""
    picked = options.furnishing or options.near_m is not None or options.box_m is not None or segments.how.get("edited")
    if picked or not set(names) & set(FURNITURE):
        return []
    found = furnishing(cloud, segments, names, _slender(cloud, segments))
    return [label for label in found if label not in given and names[label] not in options.kinds]


def _slender(cloud: PointCloud, segments: Segments) -> list[int]:
    """Labels of the objects that are at least three times as long as their section is deep: beams and columns, no crates, tables or plates."""
    found = []
    for label, role in enumerate(segments.kinds):
        points = cloud.points[segments.labels == label]
        if role != "object" or len(points) < 3:
            continue
        local = points - points.mean(axis=0)
        local = local @ np.linalg.eigh(local.T @ local)[1]
        angles = np.radians(np.arange(0, 90, 5))  # the axes of a square section are any
        turned = local[:, :2] @ np.stack([np.cos(angles), np.sin(angles)]), local[:, :2] @ np.stack([-np.sin(angles), np.cos(angles)])
        deep = np.maximum(*(_extents(values) for values in turned)).min()
        if _extents(local[:, 2]) >= _SLENDER * deep:
            found.append(label)
    return found


def _extents(values: FloatArray) -> FloatArray:
    """Of values (n, ...), but for one in a hundred at each end."""
    low, high = np.quantile(values, [_TAIL, 1.0 - _TAIL], axis=0)
    extents: FloatArray = np.asarray(high - low)
    return extents


def _of_kinds(
    labels: list[int], roles: Sequence[str], names: Sequence[str], kinds: Sequence[str], left_out: dict[str, list[int]], slender: Collection[int]
) -> list[int]:
    """The labels whose role or kind is among `kinds`; of the others the role tells why they are not, for a kind is only a guess.

    slender : labels that "member" stands for.
    """
    for kind in kinds:
        near = difflib.get_close_matches(kind, KINDS, n=1)
        says = f"select.kinds: there is no kind {kind!r}{f', did you mean {near[0]!r}?' if near else ''}; there are {', '.join(KINDS)}"
        require(kind in KINDS, UsageError, says)

    def fits(label: int) -> bool:
        name = UNKNOWN if names[label] == roles[label] == "object" else names[label]
        return roles[label] in kinds or name in kinds or label in slender

    def says_of(label: int) -> str:
        role, name = roles[label], names[label]
        if role == "object" and tuple(kinds) == (MEMBER,):
            return "no member: less than three times as long as deep"
        return _KIND_SAYS.get(name, _ROLE_SAYS["support"]) if role == "support" else _ROLE_SAYS.get(role, f"of kind {name}")

    wanted = list(labels)
    for told in dict.fromkeys(says_of(label) for label in labels if not fits(label)):
        others = {label: fits(label) or says_of(label) != told for label in wanted}
        wanted = _keep(wanted, others.__getitem__, f"{told} (select.kinds)", left_out)
    return wanted


def _by_place(cloud: PointCloud, segments: Segments, options: SelectOptions, labels: list[int], left_out: dict[str, list[int]]) -> list[int]:
    """The labels of the wanted size and place."""
    if options.least_m <= 0 and options.most_m is None and options.box_m is None and options.near_m is None:
        return labels
    own = {label: cloud.points[segments.labels == label] for label in labels}
    low, high = {k: p.min(axis=0) for k, p in own.items()}, {k: p.max(axis=0) for k, p in own.items()}
    size = {label: float(np.linalg.norm(high[label] - low[label])) for label in labels}
    most = np.inf if options.most_m is None else options.most_m
    labels = _keep(labels, lambda label: size[label] >= options.least_m, f"smaller than select.least_m = {options.least_m:g} m", left_out)
    labels = _keep(labels, lambda label: size[label] <= most, f"larger than select.most_m = {most:g} m", left_out)
    if options.box_m is not None:
        corners = np.array(options.box_m).reshape(2, 3)
        first, last = corners.min(axis=0), corners.max(axis=0)
        middle = {label: (low[label] + high[label]) / 2 for label in labels}
        inside = {label: bool(((middle[label] >= first) & (middle[label] <= last)).all()) for label in labels}
        labels = _keep(labels, inside.__getitem__, "outside select.box_m", left_out)
    if options.near_m is not None and labels:
        away = {label: float(((own[label] - np.array(options.near_m)) ** 2).sum(axis=1).min()) for label in labels}
        nearest = min(labels, key=lambda label: (away[label], label))
        labels = _keep(labels, lambda label: label == nearest, "not the nearest to select.near_m", left_out)
    return labels


def _note(labels: list[int], why: str) -> str:
    """What was left out and why; empty if nothing was."""
    if not labels:
        return ""
    shown = ", ".join(str(label) for label in labels[:8]) + (", ..." if len(labels) > 8 else "")
    return f"not modelled: {why} ({len(labels)} segment{'s' if len(labels) > 1 else ''}, label {shown})"
