"""What training leaves: one .npz of plain arrays, read without pickle. One is shipped; `scan2fea train` makes others."""

from __future__ import annotations

import functools
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, InputError, require
from scan2fea.segmentation.canonical import GRID, N_CHANNELS, N_EXTRA
from scan2fea.segmentation.features import FEATURES
from scan2fea.segmentation.forest import Forest
from scan2fea.segmentation.kinds import KindNetwork
from scan2fea.segmentation.network import CHANNELS
from scan2fea.types import Value

FORMAT = "scan2fea weights 1"
SHIPPED = "weights.npz"
Array = npt.NDArray[Any]
_FOREST = ("root", "feature", "limit", "child", "share")
_LAYERS = tuple(f"{letter}{k}" for k in (1, 2, 3, 4) for letter in "wb")


@dataclass(frozen=True, eq=False, kw_only=True)
class Weights(Value):
    """forest : names each point's class.   network : names each object's kind."""

    forest: Forest
    network: KindNetwork


def arrays_of(weights: Weights) -> dict[str, Array]:
    """The arrays of the file, by name."""
    forest, network = weights.forest, weights.network
    out: dict[str, Array] = {
        "format": np.array(FORMAT), "features": np.array(FEATURES), "classes": np.array(forest.classes), "kinds": np.array(network.kinds),
        "temperature": np.array(network.temperature),
    }  # fmt: skip
    out |= {f"forest_{name}": getattr(forest, name) for name in ("limit", "share")}
    out |= {f"forest_{name}": getattr(forest, name).astype(np.int32) for name in ("root", "feature", "child")}
    return out | {f"network_{name}": value for name, value in network.params.items()}


def weights_of(arrays: Mapping[str, Array], name: str) -> Weights:
    """Back from the arrays; `name` of the file for messages. Raises FormatError where they are not those of this version, or do not fit together."""
    says = f"{name}: not weights of this version of scan2fea; make them again with `scan2fea train`"
    wanted = {"format", "features", "classes", "kinds", "temperature", *(f"forest_{n}" for n in _FOREST), *(f"network_{n}" for n in _LAYERS)}
    require(wanted <= set(arrays), FormatError, says)
    require(str(arrays["format"]) == FORMAT and tuple(arrays["features"].tolist()) == FEATURES, FormatError, says)
    root, feature, child = (np.asarray(arrays[f"forest_{n}"], np.int64) for n in ("root", "feature", "child"))
    limit, share = (np.asarray(arrays[f"forest_{n}"], np.float32) for n in ("limit", "share"))
    classes, kinds = tuple(map(str, arrays["classes"].tolist())), tuple(map(str, arrays["kinds"].tolist()))
    m = len(feature)
    sound = share.shape == (m, len(classes)) and len(limit) == len(child) == m and bool((feature < len(FEATURES)).all())
    # a child lies behind its parent: no walk through the trees is endless
    sound = sound and bool(((child > np.arange(m)) & (child + 1 < m))[feature >= 0].all())
    sound = sound and bool(((root >= 0) & (root < m)).all())
    params = {n: np.asarray(arrays[f"network_{n}"], np.float32) for n in _LAYERS}
    flat = int(np.prod([edge // 4 for edge in GRID])) * CHANNELS[1] + N_EXTRA
    sound = sound and params["w1"].shape == (27 * N_CHANNELS, CHANNELS[0]) and params["w2"].shape == (27 * CHANNELS[0], CHANNELS[1])
    sound = sound and params["w3"].shape[0] == flat and params["w4"].shape == (params["w3"].shape[1], len(kinds))
    sound = sound and all(params[f"b{k}"].shape == params[f"w{k}"].shape[1:] for k in (1, 2, 3, 4))
    temperature = float(arrays["temperature"])
    sound = sound and temperature > 0 and all(np.isfinite(value).all() for value in (*params.values(), limit, share))
    require(sound, FormatError, f"{name}: the arrays do not fit together; make them again with `scan2fea train`")
    forest = Forest(classes=classes, root=root, feature=feature, limit=limit, child=child, share=share)
    return Weights(forest=forest, network=KindNetwork(kinds=kinds, params=params, temperature=temperature))


def read_weights(path: Path) -> Weights:
    """The weights of a file. Raises InputError where it cannot be read, FormatError where it holds something else."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}): name weights that `scan2fea train` wrote") from error
    except (ValueError, zipfile.BadZipFile, KeyError, EOFError, AttributeError, TypeError) as error:
        raise FormatError(f"{path}: not weights of scan2fea (no .npz file, or a broken one); make them with `scan2fea train`") from error
    return weights_of(arrays, str(path))


@functools.cache
def shipped_weights() -> Weights:
    """The weights of the package."""
    with resources.as_file(resources.files("scan2fea.segmentation").joinpath(SHIPPED)) as path:
        return read_weights(path)


def weights_named(path: str) -> Weights:
    """Those of a file, or the shipped ones for ""."""
    return read_weights(Path(path)) if path else shipped_weights()
