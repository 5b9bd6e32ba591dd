"""What `scan2fea train` does: simulated (or a user's) points of known class, and simulated objects of known kind, into one file of weights.

Tested on rooms and objects of other seeds than those trained on; the figures go beside the weights as JSON.
"""

from __future__ import annotations

import io
import itertools
import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InputError, UsageError, require
from scan2fea.io import InputOptions, read_scan, write_text
from scan2fea.io.files import write_bytes
from scan2fea.pipeline.results import finite_tree
from scan2fea.segmentation.canonical import GRID, N_CHANNELS, N_EXTRA, look_at
from scan2fea.segmentation.features import point_features
from scan2fea.segmentation.forest import Forest, class_probabilities, grown
from scan2fea.segmentation.kinds import LEAST_CONFIDENCE, OBJECT_KINDS, KindNetwork, fitted_temperature, kind_probabilities
from scan2fea.segmentation.learned import thinned_for_features
from scan2fea.segmentation.network import initial, logits, trained
from scan2fea.segmentation.weights import Weights, arrays_of, weights_named
from scan2fea.simulation.kind_objects import objects_of_kind
from scan2fea.simulation.kind_rooms import POINT_CLASSES, classed_room
from scan2fea.types import FloatArray, IntArray, Value

Say = Callable[[str], None]
Rows = tuple[npt.NDArray[np.float32], IntArray]  # features and classes of points
VIEWS = 3
_APART = 100_000  # between the seeds of training, calibration and test: no object is in two of them
_RATE = 2e-3
_POINTS_PER_CLASS = 20_000
_BINS = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
_DATE = (1980, 1, 1, 0, 0, 0)
_TESTED = 5  # every fifth block of a user's points tests


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """objects : of each kind to train on, each seen three times (a fifth as many calibrate, a quarter test).   rooms : likewise (a third test).

    epochs : passes over the objects.   names : of the classes of a user's labels, in the order of the labels.   objects = 0 keeps the network of
    `base`, a file of weights ("" for the shipped one); rooms = 0 its forest, unless there are labelled files.
    """

    objects: int = 170
    rooms: int = 15
    epochs: int = 8
    seed: int = 0
    names: tuple[str, ...] = ()
    base: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Looks(Value):
    """Objects as the network sees them. grids : (n, 20, 20, 8, 4) float16.   extras : (n, 9).   label, seen, noise : (n,)."""

    grids: npt.NDArray[np.float16]
    extras: npt.NDArray[np.float32]
    label: IntArray
    seen: FloatArray
    noise: FloatArray


def train(labelled: Sequence[Path], out: Path, options: TrainOptions, inputs: InputOptions, say: Say = lambda _: None) -> dict[str, Any]:
    """Write the weights to `out` and the figures beside it (.json); returns these.

    labelled : files whose label column gives the class of each point; without any the classes are those of simulated rooms.
    Raises UsageError for an output of another name or a number out of range, InputError for files that hold no labels.
    """
    require(out.suffix == ".npz", UsageError, f"-o {out}: weights are written as .npz; give a name that ends so")
    least = min(options.objects, options.rooms, options.epochs, options.seed)
    require(least >= 0, UsageError, f"--objects, --rooms, --epochs and --seed are numbers from 0 up; one is {least}")
    needs_base = options.objects == 0 or (options.rooms == 0 and not labelled)
    base = weights_named(options.base) if needs_base else None
    report: dict[str, Any] = {"schema": "scan2fea train 1", "options": {**vars(options)}, "labelled": [str(path) for path in labelled]}
    if labelled:
        forest, report["points"] = _forest_of_files(labelled, options, inputs, say)
    elif base is not None and options.rooms == 0:
        forest = base.forest
    else:
        forest, report["points"] = _forest_of_rooms(options, say)
    if base is not None and options.objects == 0:
        network = base.network
    else:
        network, report["objects"] = _network(options, say)
    arrays = arrays_of(Weights(forest=forest, network=network))
    write_bytes(out, _npz(arrays))
    report = dict(finite_tree(report))
    write_text(out.with_suffix(".json"), json.dumps(report, indent=1, allow_nan=False) + "\n")
    return report


def _npz(arrays: dict[str, npt.NDArray[Any]]) -> bytes:
    """An .npz with fixed dates: the same arrays give the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(arrays):
            member = zipfile.ZipInfo(f"{name}.npy", _DATE)
            member.create_system, member.external_attr, member.compress_type = 3, 0o644 << 16, zipfile.ZIP_DEFLATED
            content = io.BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(arrays[name]) if arrays[name].ndim else arrays[name], allow_pickle=False)
            archive.writestr(member, content.getvalue())
    return buffer.getvalue()


# ------------------------------------------------------------------ points


def _forest_of_rooms(options: TrainOptions, say: Say) -> tuple[Forest, dict[str, Any]]:
    parts: dict[str, list[Rows]] = {"train": [], "test": []}
    n_test = -(-options.rooms // 3)
    for name, first, n in (("train", options.seed, options.rooms), ("test", options.seed + _APART, n_test)):
        for number in range(n):
            say(f"room {number + 1} of {n} to {name}")
            parts[name].append(_features_of(*classed_room(first + number)))
    return _grown(parts["train"], parts["test"], POINT_CLASSES, options.seed)


def _forest_of_files(files: Sequence[Path], options: TrainOptions, inputs: InputOptions, say: Say) -> tuple[Forest, dict[str, Any]]:
    """Every fifth block of each file tests: blocks are cubes of 40 spacings, so that neighbours of a tested point were not trained on."""
    train_parts, test_parts, found = [], [], []
    for path in files:
        say(f"reading {path}")
        cloud = read_scan(path, inputs).scan.cloud
        has = cloud.label is not None and bool((cloud.label >= 0).any())
        require(has, InputError, f"{path}: no point has a label: name the column with --labels, or run without files to train on simulated rooms")
        known = np.flatnonzero(cloud.label >= 0) if cloud.label is not None else np.zeros(0, np.int64)
        found.append((cloud.points[known], np.zeros(0, np.int64) if cloud.label is None else cloud.label[known]))
    values = np.unique(np.concatenate([label for _, label in found]))
    names = options.names or tuple(f"class {value}" for value in values.tolist())
    listed = ", ".join(map(str, values[:12].tolist()))
    says = f"--names gives {len(names)} names, but the files have {len(values)} classes ({listed}): give one each, in this order"
    require(len(names) == len(values), UsageError, says)
    require(len(values) >= 2, InputError, f"all points have the same label {values.tolist()}: training needs at least two classes")
    for points, label in found:
        features, own, thin = _features_and_places(points, np.searchsorted(values, label))
        block = np.floor((thin - thin.min(axis=0)) / (40 * thinned_for_features(points)[2])).astype(np.int64) @ np.array([1, 2, 3])
        is_test = block % _TESTED == 0
        train_parts.append((features[~is_test], own[~is_test]))
        test_parts.append((features[is_test], own[is_test]))
    if not sum(len(label) for _, label in train_parts):  # a file within one block
        train_parts = test_parts
    return _grown(train_parts, test_parts, names, options.seed)


def _features_of(points: FloatArray, label: IntArray) -> Rows:
    features, own, _ = _features_and_places(points, label)
    return features, own


def _features_and_places(points: FloatArray, label: IntArray) -> tuple[npt.NDArray[np.float32], IntArray, FloatArray]:
    """Features of the thinned points, the class that most points of each have, and their places."""
    thin, stands_for, h = thinned_for_features(points)
    votes = np.zeros((len(thin), int(label.max(initial=0)) + 1), np.int64)
    np.add.at(votes, (stands_for, label), 1)
    return point_features(thin, h), votes.argmax(axis=1).astype(np.int64), thin


def _grown(train_parts: Sequence[Rows], test_parts: Sequence[Rows], names: tuple[str, ...], seed: int) -> tuple[Forest, dict[str, Any]]:
    features, label = (np.concatenate([part[k] for part in train_parts]) for k in (0, 1))
    rng = np.random.default_rng([seed, 5])
    rows = np.concatenate([rng.permutation(np.flatnonzero(label == c))[:_POINTS_PER_CLASS] for c in range(len(names))])
    forest = grown(features[rows], label[rows], names, seed=seed)
    asked, truth = (np.concatenate([part[k] for part in test_parts]) for k in (0, 1))
    told = class_probabilities(forest, asked).argmax(axis=1)
    table = np.zeros((len(names), len(names)), np.int64)
    np.add.at(table, (truth, told), 1)
    both = np.diag(table)
    iou = both / np.maximum(table.sum(axis=0) + table.sum(axis=1) - both, 1)
    figures = {
        "classes": names, "n_trained": len(rows), "n_tested": len(truth), "accuracy": float(both.sum() / max(len(truth), 1)),
        "iou": {name: float(value) if table[k].sum() else None for k, (name, value) in enumerate(zip(names, iou, strict=True))},
        "confusion": table,
    }  # fmt: skip
    return forest, figures


# ------------------------------------------------------------------ objects


def looks_of_kinds(first_seed: int, n_objects: int, say: Say = lambda _: None, name: str = "") -> Looks:
    """So many simulated objects of each kind, each seen three times."""
    rows: list[tuple[Any, ...]] = []
    for number in range(n_objects):
        if number % 25 == 0:
            say(f"object {number + 1} of {n_objects} of each kind{name}")
        for label, kind in enumerate(OBJECT_KINDS):
            for seen in objects_of_kind(kind, first_seed + number, VIEWS):
                look = look_at(seen.points, first_seed + number)
                if look is not None:
                    rows.append((look.grid.astype(np.float16), look.extra, label, seen.seen, seen.noise))
    return Looks(
        grids=np.stack([row[0] for row in rows]), extras=np.stack([row[1] for row in rows]), label=np.array([row[2] for row in rows], np.int64),
        seen=np.array([row[3] for row in rows]), noise=np.array([row[4] for row in rows]),
    )  # fmt: skip


def _network(options: TrainOptions, say: Say) -> tuple[KindNetwork, dict[str, Any]]:
    sizes = (options.objects, max(options.objects // 5, 1), max(options.objects // 4, 1))
    names = (" to train", " to calibrate", " to test")
    looks = [looks_of_kinds(options.seed + k * _APART, n, say, name) for k, (n, name) in enumerate(zip(sizes, names, strict=True))]
    params = initial((*GRID, N_CHANNELS), N_EXTRA, len(OBJECT_KINDS), options.seed)
    say(f"training the network on {len(looks[0].label)} looks, {options.epochs} times")
    params, losses = trained(params, looks[0].grids, looks[0].extras, looks[0].label, epochs=options.epochs, rate=_RATE, seed=options.seed)
    network = KindNetwork(kinds=OBJECT_KINDS, params=params, temperature=1.0)
    network = replace(network, temperature=fitted_temperature(logits(params, looks[1].grids, looks[1].extras), looks[1].label))
    return network, {"losses": losses, "temperature": network.temperature, "n_trained": len(looks[0].label), **judged(network, looks[2])}


def judged(network: KindNetwork, looks: Looks) -> dict[str, Any]:
    """Accuracy over all looks, over those that are named at all, by share seen and noise; the reliability table; confusion (rows: truth)."""
    p = kind_probabilities(network, looks.grids, looks.extras)
    best, sure = p.argmax(axis=1), p.max(axis=1)
    right = best == looks.label
    named = sure >= LEAST_CONFIDENCE
    table = np.zeros((len(network.kinds),) * 2, np.int64)
    np.add.at(table, (looks.label, best), 1)

    def share(rows: npt.NDArray[np.bool_]) -> float | None:
        return float(right[rows].mean()) if rows.any() else None

    bins = [(low, high, (sure >= low) & ((sure < high) | (high == 1.0))) for low, high in itertools.pairwise(_BINS)]
    reliability = [
        {"from": low, "to": high, "n": int(rows.sum()), "confidence": float(sure[rows].mean()) if rows.any() else None, "accuracy": share(rows)}
        for low, high, rows in bins
    ]
    parts = [(low, (looks.seen >= low) & (looks.seen < low + 0.1 + (low > 0.85))) for low in (0.5, 0.6, 0.7, 0.8, 0.9)]
    noises = [(low, high, (looks.noise >= low) & (looks.noise < high)) for low, high in ((0, 0.003), (0.003, 0.01), (0.01, 0.05))]
    gaps = [abs(float(sure[rows].mean()) - float(right[rows].mean())) * rows.mean() for _, _, rows in bins if rows.any()]
    return {
        "kinds": network.kinds, "n_tested": len(best), "accuracy": share(np.ones(len(best), bool)), "unknown": float((~named).mean()),
        "accuracy_named": share(named), "calibration_error": float(sum(gaps)), "reliability": reliability,
        "by_seen": {f"{low:g} to {low + 0.1:g}": share(rows) for low, rows in parts},
        "by_noise": {f"{low:g} to {high:g}": share(rows) for low, high, rows in noises},
        "confusion": table,
    }  # fmt: skip
