"""A small convolutional network in numpy: two convolutions with pooling, two full layers, softmax (thesis 2.4.1, eq 2.8-2.12 as corrected).

Arrays are channels last: x (n, p, q, r, c). A layer is y = b + sum w x (2.8), pooling takes the largest of 2 x 2 x 2 (2.9), p is softmax(W f + b)
(2.10), the loss is the cross entropy of label and p (2.12), and a step is x <- x - g grad L (2.11) with g scaled per weight by Adam (Kingma and Ba
2015).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.types import FloatArray, IntArray

Array = npt.NDArray[Any]  # float32 in use, float64 where gradients are checked
Parameters = Mapping[str, Array]

CHANNELS, HIDDEN = (8, 24), 64
_BATCH = 32
_DECAY = 1e-4  # of weights, a step and rate
_MOMENTS = (0.9, 0.999)


def initial(shape: tuple[int, int, int, int], n_extra: int, n_classes: int, seed: int) -> dict[str, Array]:
    """Weights of the variance 2 / inputs (He et al. 2015), in float32. shape : (p, q, r, channels) of one input, n_extra numbers beside it."""
    rng = np.random.default_rng(seed)
    p, q, r, c = shape
    flat = (p // 4) * (q // 4) * (r // 4) * CHANNELS[1]

    def drawn(rows: int, columns: int) -> Array:
        return np.asarray(rng.standard_normal((rows, columns)) * np.sqrt(2.0 / rows), np.float32)

    sizes = {"1": (27 * c, CHANNELS[0]), "2": (27 * CHANNELS[0], CHANNELS[1]), "3": (flat + n_extra, HIDDEN), "4": (HIDDEN, n_classes)}
    weights = {f"w{k}": drawn(*size) for k, size in sizes.items()}
    return {**weights, **{f"b{k}": np.zeros(size[1], np.float32) for k, size in sizes.items()}}


def _patches(x: Array) -> Array:
    """(n p q r, 27 c): what a 3 x 3 x 3 kernel sees at each place, zeros beyond the border."""
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1), (1, 1), (0, 0)))
    seen = np.lib.stride_tricks.sliding_window_view(padded, (3, 3, 3), axis=(1, 2, 3))  # (n, p, q, r, c, 3, 3, 3)
    return np.ascontiguousarray(seen.transpose(0, 1, 2, 3, 5, 6, 7, 4)).reshape(-1, 27 * x.shape[-1])


def _blocks(x: Array) -> Array:
    """(n, p/2, 2, q/2, 2, r/2, 2, c)."""
    n, p, q, r, c = x.shape
    return x.reshape(n, p // 2, 2, q // 2, 2, r // 2, 2, c)


def _pooled(x: Array) -> tuple[Array, Array]:
    """The largest of each block, and the share of each input in it (ties share)."""
    blocks = _blocks(x)
    top = blocks.max(axis=(2, 4, 6))
    share = (blocks == top[:, :, None, :, None, :, None]).astype(x.dtype)
    return top, share / share.sum(axis=(2, 4, 6), keepdims=True)


def _unpooled(grad: Array, share: Array) -> Array:
    n, p, _, q, _, r, _, c = share.shape
    return np.asarray(share * grad[:, :, None, :, None, :, None]).reshape(n, 2 * p, 2 * q, 2 * r, c)


def _layers(params: Parameters, x: Array, extra: Array) -> dict[str, Array]:
    """Everything the backward pass needs, and `logits` (n, classes)."""
    n, p, q, r, _ = x.shape
    kept: dict[str, Array] = {"patches1": _patches(x)}
    y = np.maximum(kept["patches1"] @ params["w1"] + params["b1"], 0).reshape(n, p, q, r, -1)
    kept["top1"], kept["share1"] = _pooled(y)
    kept["patches2"] = _patches(kept["top1"])
    y = np.maximum(kept["patches2"] @ params["w2"] + params["b2"], 0).reshape(*kept["top1"].shape[:4], -1)
    kept["top2"], kept["share2"] = _pooled(y)
    kept["flat"] = np.concatenate([kept["top2"].reshape(n, -1), extra], axis=1)
    kept["hidden"] = np.maximum(kept["flat"] @ params["w3"] + params["b3"], 0)
    kept["logits"] = kept["hidden"] @ params["w4"] + params["b4"]
    return kept


def softmax(logits: Array) -> Array:
    """(n, k) rows that sum to 1."""
    e = np.exp(logits - logits.max(axis=1, keepdims=True))
    return np.asarray(e / e.sum(axis=1, keepdims=True))


def logits(params: Parameters, x: Array, extra: Array) -> FloatArray:
    """(n, classes) in float64; x (n, p, q, r, c), extra (n, e). A few inputs at a time, so that memory stays small."""
    batches = [slice(k, k + _BATCH) for k in range(0, len(x), _BATCH)]
    parts = [_layers(params, x[rows].astype(params["w1"].dtype), extra[rows])["logits"] for rows in batches]
    return np.concatenate(parts).astype(np.float64) if parts else np.zeros((0, len(params["b4"])))


def loss_and_gradients(params: Parameters, x: Array, extra: Array, label: IntArray) -> tuple[float, dict[str, Array]]:
    """Mean cross entropy of the labels (n,) and its derivative with respect to every weight."""
    kept = _layers(params, x, extra)
    n = len(x)
    p = softmax(kept["logits"])
    loss = -float(np.log(np.maximum(p[np.arange(n), label], 1e-30)).mean())
    grad: dict[str, Array] = {}
    back = p.copy()
    back[np.arange(n), label] -= 1
    back /= n
    grad["w4"], grad["b4"] = kept["hidden"].T @ back, back.sum(axis=0)
    back = (back @ params["w4"].T) * (kept["hidden"] > 0)
    grad["w3"], grad["b3"] = kept["flat"].T @ back, back.sum(axis=0)
    top2 = kept["top2"]
    back = (back @ params["w3"].T)[:, : top2[0].size].reshape(top2.shape) * (top2 > 0)
    back = _unpooled(back, kept["share2"]).reshape(-1, CHANNELS[1])
    grad["w2"], grad["b2"] = kept["patches2"].T @ back, back.sum(axis=0)
    shape = kept["top1"].shape
    # what a kernel sees, seen from the input: the same kernel mirrored, channels in and out exchanged
    mirrored = params["w2"].reshape(27, CHANNELS[0], CHANNELS[1])[::-1].transpose(0, 2, 1).reshape(27 * CHANNELS[1], CHANNELS[0])
    back = (_patches(back.reshape(*shape[:4], CHANNELS[1])) @ mirrored).reshape(shape) * (kept["top1"] > 0)
    back = _unpooled(back, kept["share1"]).reshape(-1, CHANNELS[0])
    grad["w1"], grad["b1"] = kept["patches1"].T @ back, back.sum(axis=0)
    return loss, grad


def trained(
    params: Parameters, x: Array, extra: Array, label: IntArray, *, epochs: int, rate: float, seed: int
) -> tuple[dict[str, Array], list[float]]:
    """The weights after so many passes over the inputs in an order drawn anew, and the mean loss of each pass; the rate falls to 0 along a cosine.

    The first two axes of an input are mirrored at random: a section seen from its other end or side is the same section.
    """
    rng = np.random.default_rng(seed)
    now = {name: np.array(value) for name, value in params.items()}
    first, second = ({name: np.zeros_like(value) for name, value in now.items()} for _ in range(2))
    steps_all, step, losses = epochs * -(-len(x) // _BATCH), 0, []
    for _ in range(epochs):
        order, total = rng.permutation(len(x)), 0.0
        for k in range(0, len(x), _BATCH):
            rows = order[k : k + _BATCH]
            flip = rng.random(3) < 0.5
            seen = x[rows].astype(now["w1"].dtype)[:, :: -1 if flip[0] else 1, :: -1 if flip[1] else 1, :: -1 if flip[2] else 1]
            loss, grad = loss_and_gradients(now, seen, extra[rows], label[rows])
            total += loss * len(rows)
            pace = 0.5 * rate * (1 + np.cos(np.pi * step / steps_all))
            step += 1
            for name, g in grad.items():
                first[name] = _MOMENTS[0] * first[name] + (1 - _MOMENTS[0]) * g
                second[name] = _MOMENTS[1] * second[name] + (1 - _MOMENTS[1]) * g * g
                scale = np.sqrt(second[name] / (1 - _MOMENTS[1] ** step)) + 1e-8
                move = first[name] / (1 - _MOMENTS[0] ** step) / scale + (_DECAY * now[name] if name[0] == "w" else 0)
                now[name] = (now[name] - pace * move).astype(now[name].dtype)
        losses.append(total / max(len(x), 1))
    return now, losses

