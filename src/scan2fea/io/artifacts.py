"""Every value of scan2fea to disk and back, bit for bit: what resume and child processes read.

The file is a zip of `tree.json` and one `.npy` per array, with fixed dates: the same value gives the same bytes. Only dataclasses defined in
modules of scan2fea are written or made again, by name; nothing is ever unpickled.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, InternalError, Scan2FeaError, require
from scan2fea.io.files import existing_file, replacing

_SCHEMA = "scan2fea artifact 1"
_DATE = (1980, 1, 1, 0, 0, 0)  # the first date a zip can hold
_PACKAGE = "scan2fea."

Array = npt.NDArray[Any]


def save(value: Any, path: Path) -> None:
    """Write a value: any dataclass of scan2fea, tuple, list, mapping, array, number, string, bytes, path or None, nested at will.

    Raises InternalError for anything else, UsageError where the folder cannot be written to.
    """
    arrays: list[Array] = []
    tree = {"schema": _SCHEMA, "value": _encoded(value, arrays)}
    with replacing(path) as handle, zipfile.ZipFile(handle, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_member("tree.json"), json.dumps(tree, separators=(",", ":")))
        for number, array in enumerate(arrays):
            with archive.open(_member(f"{number}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, version=(2, 0), allow_pickle=False)


def load(path: Path) -> Any:
    """Read back what `save` wrote. Raises InputError where the file cannot be read, FormatError where it is not a sound artifact of this version."""
    existing_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            tree = json.loads(archive.read("tree.json"))
            require(tree.get("schema") == _SCHEMA, FormatError, f"{path} was written by another version of scan2fea: run without --resume")
            arrays = [_array(archive, f"{k}.npy") for k in range(len(archive.namelist()) - 1)]
        return _decoded(tree["value"], arrays)
    except Scan2FeaError:
        raise
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, IndexError, AttributeError, OSError, EOFError, RecursionError) as error:
        raise FormatError(f"{path} is damaged ({error}): delete it and run again") from error


def fingerprint(value: Any) -> str:
    """SHA-256 of a value: equal exactly where `save` would write the same bytes."""
    arrays: list[Array] = []
    digest = hashlib.sha256(json.dumps(_encoded(value, arrays), separators=(",", ":")).encode())
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _member(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, _DATE)
    info.create_system, info.external_attr = 3, 0o644 << 16  # the same bytes on every system
    return info


def _array(archive: zipfile.ZipFile, name: str) -> Array:
    with archive.open(name) as member:
        array = np.lib.format.read_array(member, allow_pickle=False)
    array.flags.writeable = False
    return array


def _encoded(value: Any, arrays: list[Array]) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return _encoded_array(value, arrays)
    if value is None or type(value) in (bool, int, float, str):
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _encoded_dataclass(value, arrays)
    if isinstance(value, Mapping):
        return {"map": [[_encoded(k, arrays), _encoded(v, arrays)] for k, v in value.items()]}
    if type(value) in (tuple, list):
        return {type(value).__name__: [_encoded(item, arrays) for item in value]}
    if isinstance(value, bytes):
        return {"bytes": _encoded_array(np.frombuffer(value, np.uint8), arrays)}
    if isinstance(value, PurePath):
        return {"path": str(value)}
    raise InternalError(f"a {type(value).__qualname__} cannot be kept on disk: use dataclasses of scan2fea, arrays, numbers, text, tuples, mappings")


def _encoded_array(value: Array | np.generic, arrays: list[Array]) -> Any:
    array = np.asarray(value)
    require(not array.dtype.hasobject, InternalError, "an array of Python objects cannot be kept on disk: use numbers")
    arrays.append(array if array.ndim == 0 else np.ascontiguousarray(array))
    return {"scalar" if isinstance(value, np.generic) else "array": len(arrays) - 1}


def _encoded_dataclass(value: Any, arrays: list[Array]) -> Any:
    kind = type(value)
    name = f"{kind.__module__}:{kind.__qualname__}"
    require(_class(name) is kind, InternalError, f"{name} cannot be kept on disk: define it at the top of a module of scan2fea")
    return {"is": name, "of": {field.name: _encoded(getattr(value, field.name), arrays) for field in dataclasses.fields(value) if field.init}}


def _class(name: str) -> type | None:
    """The dataclass of that name in scan2fea, or None."""
    module, _, qualname = name.partition(":")
    if not module.startswith(_PACKAGE) or not qualname.isidentifier():
        return None
    try:
        found = getattr(importlib.import_module(module), qualname, None)
    except ImportError:
        return None
    return found if isinstance(found, type) and dataclasses.is_dataclass(found) and found.__module__ == module else None


def _decoded(node: Any, arrays: list[Array]) -> Any:
    if not isinstance(node, dict):
        return node
    if "is" in node:
        return _decoded_dataclass(node, arrays)
    ((kind, content),) = node.items()
    if kind == "array":
        return arrays[content]
    if kind == "scalar":
        return arrays[content][()]
    if kind == "map":
        return {_decoded(k, arrays): _decoded(v, arrays) for k, v in content}
    if kind == "bytes":
        return _decoded(content, arrays).tobytes()
    if kind == "path":
        return Path(content)
    if kind in ("tuple", "list"):
        items = [_decoded(item, arrays) for item in content]
        return tuple(items) if kind == "tuple" else items
    raise FormatError(f"an artifact holds {kind!r}, which this version does not know: run without --resume")


def _decoded_dataclass(node: dict[str, Any], arrays: list[Array]) -> Any:
    kind = _class(node["is"])
    if kind is None:
        raise FormatError(f"an artifact holds a {node['is']!r}, which is no value of this version of scan2fea: run without --resume")
    known = {field.name for field in dataclasses.fields(kind) if field.init}
    require(known == set(node["of"]), FormatError, f"a {node['is']} was written by another version of scan2fea: run without --resume")
    return kind(**{name: _decoded(content, arrays) for name, content in node["of"].items()})
