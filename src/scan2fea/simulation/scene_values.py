"""Values of scene files: lengths with units, tables with known keys, and options filled from them; every refusal names where it stands."""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
import typing
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from scan2fea.errors import InputError, UsageError, require
from scan2fea.types import FloatArray
from scan2fea.units import metres_per

FARTHEST_M = 1e8  # of a position: beyond, doubles lose the last 10 nm
_LENGTH = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*([A-Za-z_]+)\s*$")


def length_of(value: Any, where: str) -> float:
    """Metres of a number or of text with a unit. Raises InputError."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        metres = float(value)
    else:
        match = _LENGTH.match(value) if isinstance(value, str) else None
        require(match is not None, InputError, f'{where} is {value!r}: write metres, or text with a unit such as "127 mm"')
        try:
            metres = float(Decimal(match[1]) * Decimal(str(metres_per(match[2]))))  # type: ignore[index]  # 9 mm is 0.009, not 0.009000000000000001
        except UsageError as error:
            raise InputError(f"{where} is {value!r}: {error}") from error
    require(math.isfinite(metres), InputError, f"{where} is {value!r}: it must be a finite length")
    return metres


def filled(options: type[Any], table: Mapping[str, Any], where: str) -> Any:
    """The dataclass of options with the keys of a table; lengths (unit "m") may have units. Raises InputError for an unknown key or a bad value."""
    fields = {f.name: f for f in dataclasses.fields(options)}
    known(table, tuple(fields), where)
    hints = typing.get_type_hints(options)
    values = {}
    for key, value in table.items():
        meta = fields[key].metadata
        converted = _metres(value, f"{where}: {key}") if meta.get("unit") == "m" else value
        converted = _tuples(converted)
        if isinstance(converted, int) and not isinstance(converted, bool) and float in (hints[key], *typing.get_args(hints[key])):
            converted = float(converted)
        _fits(converted, hints[key], meta, f"{where}: {key}")
        values[key] = converted
    return options(**values)


def _fits(value: Any, hint: Any, meta: Mapping[str, Any], where: str) -> None:
    """Raises InputError unless the value has the type, the choices and the range that the option declares."""
    require(_matches(value, hint), InputError, f"{where} is {_shown(value)}: it must be {_wanted(hint)}")
    if meta.get("choices"):
        require(value in meta["choices"], InputError, f"{where} is {value!r}{nearest(str(value), meta['choices'])}: use {', '.join(meta['choices'])}")
    for number in _flat(value):
        if isinstance(number, str | bool) or number is None:
            continue
        require(math.isfinite(number), InputError, f"{where} is {number}: it must be finite")
        for bound, sign in (("minimum", 1), ("maximum", -1)):
            limit = meta.get(bound)
            require(limit is None or sign * number >= sign * limit, InputError, f"{where} is {number:g}: its {bound} is {limit}")


def _matches(value: Any, hint: Any) -> bool:
    """Is the value of the type that an option is declared with: a number, text, a tuple of such, or one of several?"""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, tuple):
            return False
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return all(_matches(v, arguments[0]) for v in value)
        return len(value) == len(arguments) and all(_matches(v, a) for v, a in zip(value, arguments, strict=True))
    if arguments:
        return any(_matches(value, a) for a in arguments)
    return isinstance(value, hint) and (hint is bool or not isinstance(value, bool))


def _wanted(hint: Any) -> str:
    """A type in words."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            inner = _wanted(arguments[0])
            return f"a list, each entry {inner}"
        return f"a list of {len(arguments)} numbers"
    if arguments:
        return " or ".join(_wanted(a) for a in arguments if a is not type(None))
    return {float: "a number", int: "a whole number", str: "text", bool: "true or false"}.get(hint, str(hint))


def _shown(value: Any) -> str:
    return repr([*value]) if isinstance(value, tuple) else repr(value)


def _flat(value: Any) -> list[Any]:
    return [leaf for item in value for leaf in _flat(item)] if isinstance(value, tuple) else [value]


def _tuples(value: Any) -> Any:
    """Lists as tuples of floats."""
    if isinstance(value, list):
        return tuple(float(v) if isinstance(v, int) and not isinstance(v, bool) else _tuples(v) for v in value)
    return value


def _metres(value: Any, where: str) -> Any:
    return [_metres(v, where) for v in value] if isinstance(value, list) else length_of(value, where)


def three(table: Mapping[str, Any], key: str, where: str, *, lengths: bool) -> FloatArray:
    value = table.get(key, [0.0, 0.0, 0.0])
    require(isinstance(value, list) and len(value) == 3, InputError, f"{where}: {key} is {value!r}: it must be a list of three")
    if lengths:
        place = np.array([length_of(v, f"{where}: {key}") for v in value])
        require(bool((np.abs(place) <= FARTHEST_M).all()), InputError, f"{where}: {key} is {value!r}: it must lie within {FARTHEST_M:g} m")
        return place
    for v in value:
        is_number = isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v)
        require(is_number, InputError, f"{where}: {key} holds {v!r}: it must be a number")
    return np.array(value, float)


def tables(tree: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    value = tree.get(key, [])
    ok = isinstance(value, list) and all(isinstance(v, dict) for v in value)
    require(ok, InputError, f"{where}: {key} must be a list of tables")
    return list(value)


def known(table: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
    for key in table:
        require(key in keys, InputError, f"{where}: {key} is not known{nearest(key, keys)}; known are {', '.join(keys)}")


def nearest(word: str, words: Any) -> str:
    near = difflib.get_close_matches(word, list(words), n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
