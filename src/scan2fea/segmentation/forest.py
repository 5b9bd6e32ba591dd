"""A random forest (Breiman 2001) in compiled loops: grown on binned features, kept as plain arrays.

Each tree sees a draw with repetition of the rows and, at each node, a draw of the features; a node is cut where the Gini impurity falls most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, Value

Array32 = npt.NDArray[np.float32]
BINS = 64
_TREES, _DEPTH, _LEAST = 20, 12, 20


@dataclass(frozen=True, eq=False, kw_only=True)
class Forest(Value):
    """Nodes of all trees in one list. classes : names.   root : (t,) first node of each tree.

    feature : (m,) int64 that a node asks for, -1 for a leaf.   limit : (m,) a value up to it goes to `child`, above it to `child` + 1.
    share : (m, k) of the classes among the rows that came to the node.
    """

    classes: tuple[str, ...]
    root: IntArray
    feature: IntArray
    limit: Array32
    child: IntArray
    share: Array32

    _ROWS = (("feature", "limit", "child", "share"),)


def grown(features: Array32, label: IntArray, classes: tuple[str, ...], *, seed: int, trees: int = _TREES, depth: int = _DEPTH) -> Forest:
    """The forest of rows (n, f) with labels (n,) from 0. Classes count alike, however many rows each has.

    Raises SegmentationError for labels that are missing or out of range, or of one class only.
    """
    k = len(classes)
    require(len(label) == len(features) > 0, SegmentationError, f"{len(features)} points have {len(label)} labels: training needs one each")
    fits = bool(label.min() >= 0 and label.max() < k)
    require(fits, SegmentationError, f"labels run from {label.min()} to {label.max()}, but there are {k} classes: use 0 to {k - 1}")
    counts = np.bincount(label, minlength=k)
    require((counts > 0).sum() >= 2, SegmentationError, "all points have the same label: training needs at least two classes")
    rng = np.random.default_rng(seed)
    edges = np.quantile(features, np.linspace(0, 1, BINS + 1)[1:-1], axis=0).astype(np.float32)  # (bins - 1, f)
    binned = np.stack([np.searchsorted(edges[:, j], features[:, j].astype(np.float32), side="left") for j in range(features.shape[1])], axis=1)
    weight = np.where(counts > 0, len(label) / np.maximum(counts, 1) / (counts > 0).sum(), 0.0)
    tried = max(1, math.ceil(math.sqrt(features.shape[1])))
    made = []
    for _ in range(trees):
        rows = rng.integers(len(label), size=len(label))
        keys = rng.random((2 ** (depth + 1), features.shape[1]))  # at each node the features of the smallest keys are tried
        made.append(_tree(binned.astype(np.uint8), label.astype(np.int64), weight, rows, keys, tried, depth, _LEAST, BINS))
    start = np.cumsum([0] + [len(tree[0]) for tree in made])
    feature = np.concatenate([tree[0] for tree in made])
    cut = np.concatenate([tree[1] for tree in made])
    limit = np.where(feature >= 0, edges[np.minimum(cut, BINS - 2), np.maximum(feature, 0)], 0).astype(np.float32)
    child = np.concatenate([np.where(tree[2] >= 0, tree[2] + s, -1) for tree, s in zip(made, start, strict=False)])
    share = np.concatenate([tree[3] for tree in made]).astype(np.float32)
    return Forest(classes=classes, root=start[:-1].astype(np.int64), feature=feature, limit=limit, child=child, share=share)


def class_probabilities(forest: Forest, features: Array32) -> Array32:
    """(n, k) mean over the trees of the shares in the leaf that each row (n, f) comes to."""
    rows = np.ascontiguousarray(features, np.float32)
    return np.asarray(_asked(rows, forest.root, forest.feature, forest.limit, forest.child, forest.share))


@jit
def _asked(rows: Array32, root: IntArray, feature: IntArray, limit: Array32, child: IntArray, share: Array32) -> Array32:
    out = np.zeros((len(rows), share.shape[1]), np.float32)
    for i in range(len(rows)):
        for t in range(len(root)):
            node = root[t]
            while feature[node] >= 0:
                node = child[node] if rows[i, feature[node]] <= limit[node] else child[node] + 1
            for c in range(share.shape[1]):
                out[i, c] += share[node, c] / len(root)
    return out


@jit
def _best_cut(binned: IntArray, label: IntArray, weight: FloatArray, rows: IntArray, tried: IntArray, bins: int) -> tuple[int, int, float]:
    """Feature, last bin that goes left, and how much the weighted Gini impurity falls; -1 where no cut lowers it."""
    k = len(weight)
    best_feature, best_bin, best_gain = -1, 0, 1e-9
    total = np.zeros(k)
    for r in rows:
        total[label[r]] += weight[label[r]]
    mass = total.sum()
    squares = 0.0
    for c in range(k):
        squares += total[c] * total[c]
    hist = np.zeros((bins, k))
    for f in tried:
        hist[:] = 0.0
        for r in rows:
            hist[binned[r, f], label[r]] += weight[label[r]]
        left = np.zeros(k)
        for b in range(bins - 1):
            sl = sr = ml = 0.0
            for c in range(k):
                left[c] += hist[b, c]
                ml += left[c]
                sl += left[c] * left[c]
                sr += (total[c] - left[c]) ** 2
            mr = mass - ml
            if ml <= 0.0 or mr <= 1e-9 * mass:
                continue
            gain = (sl / ml + sr / mr - squares / mass) / mass
            if gain > best_gain:
                best_feature, best_bin, best_gain = f, b, gain
    return best_feature, best_bin, best_gain


@jit
def _tree(
    binned: IntArray, label: IntArray, weight: FloatArray, rows: IntArray, keys: FloatArray, tried: int, depth: int, least: int, bins: int
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """feature, cut bin, child and class shares of the nodes, parents before children."""
    k, most = len(weight), len(keys)
    feature, cut, child = np.full(most, -1, np.int64), np.zeros(most, np.int64), np.full(most, -1, np.int64)
    share = np.zeros((most, k))
    first, last, level = np.zeros(most, np.int64), np.zeros(most, np.int64), np.zeros(most, np.int64)
    rows = rows.copy()
    last[0] = len(rows)
    n = 1
    node = 0
    while node < n:
        a, b = first[node], last[node]
        for r in rows[a:b]:
            share[node, label[r]] += weight[label[r]]
        total = share[node].sum()
        for c in range(k):
            share[node, c] /= total
        if level[node] < depth and b - a >= 2 * least and n + 2 <= most:
            asked = np.argsort(keys[node])[:tried]
            f, at, _ = _best_cut(binned, label, weight, rows[a:b], asked, bins)
            if f >= 0:
                own = rows[a:b].copy()
                i, j = a, b
                for r in own:
                    if binned[r, f] <= at:
                        rows[i] = r
                        i += 1
                for r in own:
                    if binned[r, f] > at:
                        j -= 1
                        rows[j] = r
                if i - a >= least and b - i >= least:
                    feature[node], cut[node], child[node] = f, at, n
                    first[n], last[n], level[n] = a, i, level[node] + 1
                    first[n + 1], last[n + 1], level[n + 1] = i, b, level[node] + 1
                    n += 2
        node += 1
    return feature[:n], cut[:n], child[:n], share[:n]
