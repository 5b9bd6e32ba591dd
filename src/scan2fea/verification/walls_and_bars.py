"""Decks of shells and beams: how many, how large, in how many pieces, and whether each has a shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from scan2fea.types import FloatArray
from scan2fea.verification.inspect import Inspection
from scan2fea.verification.limits import at_most

Cells = Sequence[tuple[str, npt.NDArray[Any]]]
CORNERS = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4}
ENDS = {"line": (0, 1), "line3": (0, 2)}
FLAT = 1e-9  # of the square of its longest side (of a beam: of the size of the model): an element without a shape


def of_walls_and_bars(nodes: FloatArray, cells: Cells) -> Inspection:
    """nodes : (n, 3) metres.   cells : (kind, (m, k) rows of nodes), kinds of `CORNERS` (shells) and `ENDS` (beams); others are passed over."""
    shells = [nodes[np.asarray(rows)[:, : CORNERS[kind]]] for kind, rows in cells if kind in CORNERS]
    beams = [nodes[np.asarray(rows)[:, ENDS[kind]]] for kind, rows in cells if kind in ENDS]
    area = np.concatenate([np.linalg.norm(_area_vector(x), axis=1) for x in shells] or [np.zeros(0)])
    length = np.concatenate([np.linalg.norm(x[:, 1] - x[:, 0], axis=1) for x in beams] or [np.zeros(0)])
    size = float(np.ptp(nodes, axis=0).max())
    shapeless = sum(int(_is_turned(x).sum()) for x in shells) + int((length <= FLAT * size).sum())
    figures: dict[str, float] = {"nodes": len(nodes)}
    if shells:
        figures |= {"shells": len(area), "area_m2": float(area.sum())}
    if beams:
        figures |= {"beams": len(length), "length_m": float(length.sum())}
    figures["pieces"] = _n_pieces(len(nodes), cells)
    return Inspection(figures=figures, quality={}, worst={}, limits={}, checks=(at_most("elements.shapeless", shapeless),))


def _area_vector(x: FloatArray) -> FloatArray:
    """(m, 3) of polygons (m, k, 3)."""
    middle = x.mean(axis=1, keepdims=True)
    return np.asarray(np.cross(x - middle, np.roll(x, -1, axis=1) - middle).sum(axis=1) / 2)


def _is_turned(x: FloatArray) -> npt.NDArray[np.bool_]:
    """(m,) polygons (m, k, 3) without area, or with a corner of 180 degrees and more: their Jacobian is not positive there."""
    ahead, behind = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    total = _area_vector(x)
    normal = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    corner = np.einsum("mkc,mc->mk", np.cross(ahead, behind), normal).min(axis=1)
    return np.asarray(corner <= FLAT * (ahead**2).sum(axis=2).max(axis=1))


def _n_pieces(n: int, cells: Cells) -> int:
    """Parts of the model that share no node; nodes without an element do not count."""
    pairs = [np.stack([np.repeat(rows[:, :1], rows.shape[1] - 1, axis=1).ravel(), rows[:, 1:].ravel()]) for _, rows in cells]
    a, b = np.concatenate(pairs, axis=1)
    piece = connected_components(sp.coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]
    return len(np.unique(piece[a]))
