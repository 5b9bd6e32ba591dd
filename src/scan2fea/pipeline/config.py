"""One frozen Options per stage, read from TOML, `--set KEY=VALUE` and the short forms; written back as commented TOML.

Everything about an option (its text, unit, choices, range) comes from its declaration in the stage, see `scan2fea.options`.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scan2fea.acquisition import AcquisitionOptions
from scan2fea.cad import CadOptions
from scan2fea.errors import InputError, UsageError, require
from scan2fea.estimation.member import MemberOptions
from scan2fea.estimation.solid import SolidOptions
from scan2fea.fea import FeaOptions
from scan2fea.filtering import FilteringOptions
from scan2fea.fusion import FusionOptions
from scan2fea.io import InputOptions
from scan2fea.options import option
from scan2fea.pipeline.known import KnownObject, known_object, table_lines
from scan2fea.pipeline.requires import RequireOptions
from scan2fea.pipeline.route import RouteOptions
from scan2fea.reconstruction import ReconstructionOptions
from scan2fea.registration import RegistrationOptions
from scan2fea.remeshing import RemeshOptions
from scan2fea.repair import RepairOptions
from scan2fea.segmentation import METHODS, SegmentationOptions, SelectOptions
from scan2fea.tetmeshing import FillOptions
from scan2fea.units import UNIT_SYSTEMS

OBJECTS = "object"  # the field of Config whose rows are tables of their own
AUTO = "auto"  # how None ("from the data") is written in TOML, which has no null


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    units: str = option("m-N-Pa", "units of model.inp, model.bdf and surface.stl; STEP is always in millimetres", choices=tuple(UNIT_SYSTEMS))


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    seed: int = option(0, "seed of everything that draws at random", minimum=0)
    jobs: int | None = option(None, "objects converted at the same time; auto: one per processor", minimum=1)
    object_seconds: float = option(600.0, "an object that takes more processor time is stopped and fails with that reason", unit="s", minimum=1.0)
    object_gib: float = option(4.0, "an object that needs more memory is stopped and fails with that reason", unit="GiB", minimum=0.1)


@dataclass(frozen=True, kw_only=True)
class Config:
    """All options of one run; each field is one table of the TOML file."""

    input: InputOptions = field(default_factory=InputOptions)
    acquisition: AcquisitionOptions = field(default_factory=AcquisitionOptions)
    fusion: FusionOptions = field(default_factory=FusionOptions)
    registration: RegistrationOptions = field(default_factory=RegistrationOptions)
    filtering: FilteringOptions = field(default_factory=FilteringOptions)
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)
    select: SelectOptions = field(default_factory=SelectOptions)
    require: RequireOptions = field(default_factory=RequireOptions)
    route: RouteOptions = field(default_factory=RouteOptions)
    estimation: MemberOptions = field(default_factory=MemberOptions)
    solid: SolidOptions = field(default_factory=SolidOptions)
    reconstruction: ReconstructionOptions = field(default_factory=ReconstructionOptions)
    repair: RepairOptions = field(default_factory=RepairOptions)
    remeshing: RemeshOptions = field(default_factory=RemeshOptions)
    cad: CadOptions = field(default_factory=CadOptions)
    tetmeshing: FillOptions = field(default_factory=FillOptions)
    fea: FeaOptions = field(default_factory=FeaOptions)
    export: ExportOptions = field(default_factory=ExportOptions)
    run: RunOptions = field(default_factory=RunOptions)
    object: tuple[KnownObject, ...] = option((), "what is known of single objects: one [[object]] table each")


# ------------------------------------------------------------------ reading


def load_config(path: Path | None = None, settings: Mapping[str, Any] | None = None) -> Config:
    """Defaults, then the file, then `settings` (dotted key -> value; a string is read as a TOML value where it is one).

    Raises UsageError for an unknown key (naming the nearest) and a value of the wrong type or range; InputError for an unreadable file.
    """
    tree: dict[str, Any] = {}
    if path is not None:
        try:
            tree = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); give an existing TOML file with -c") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise UsageError(f"{path}: is not TOML: {error}") from error
    values = dict(_flat(tree))
    for key, value in (settings or {}).items():
        values[key] = _toml_value(value) if isinstance(value, str) else value
    config = Config()
    for key, value in values.items():
        config = _with(config, key.split("."), value, key)
    _require_choice(config.segmentation.method, tuple(METHODS), "segmentation.method")
    return _seeded(config, values)


def _seeded(config: Config, given: Mapping[str, Any]) -> Config:
    """run.seed is the seed of every stage that was not given one of its own."""
    stages = [key for key in known_keys() if key.endswith(".seed") and key != "run.seed" and key not in given]
    return with_settings(config, dict.fromkeys(stages, config.run.seed))


def with_settings(config: Config, settings: Mapping[str, Any]) -> Config:
    """`config` with some dotted keys replaced."""
    for key, value in settings.items():
        config = _with(config, key.split("."), value, key)
    return config


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def known_keys(config: Config | None = None) -> dict[str, Any]:
    """Every dotted key and its value, in the order of the TOML file."""
    return {key: value for key, value, _ in _leaves(config or Config())}


def _leaves(node: Any, prefix: str = "") -> Iterator[tuple[str, Any, dataclasses.Field[Any]]]:
    for f in dataclasses.fields(node):
        value = getattr(node, f.name)
        if dataclasses.is_dataclass(value):
            yield from _leaves(value, f"{prefix}{f.name}.")
        else:
            yield f"{prefix}{f.name}", value, f


def _with(node: Any, path: list[str], value: Any, key: str) -> Any:
    fields = {f.name: f for f in dataclasses.fields(node)}
    name, rest = path[0], path[1:]
    current = getattr(node, name, None) if name in fields else None
    if name not in fields or bool(rest) != dataclasses.is_dataclass(current):
        near = difflib.get_close_matches(key, known_keys(), n=1, cutoff=0.5)
        raise UsageError(f"option {key!r} is not known" + (f"; did you mean {near[0]!r}?" if near else "; `scan2fea config` lists them all"))
    if rest:
        return dataclasses.replace(node, **{name: _with(current, rest, value, key)})
    if key == OBJECTS:
        return dataclasses.replace(node, object=_objects(value))
    return dataclasses.replace(node, **{name: _checked(value, typing.get_type_hints(type(node))[name], fields[name], key)})


def _objects(value: Any) -> tuple[KnownObject, ...]:
    says = f"{OBJECTS} = {value!r}: expected tables; write [[object]] for each object that something is known of"
    require(isinstance(value, list | tuple), UsageError, says)
    return tuple(row if isinstance(row, KnownObject) else known_object(row, number) for number, row in enumerate(value, start=1))


def _checked(value: Any, kind: Any, f: dataclasses.Field[Any], key: str) -> Any:
    """`value` in the type of the field. Raises UsageError that names the key, the value and what is allowed."""
    members = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if value is None or (value == AUTO and type(None) in members):
        require(type(None) in members, UsageError, f"{key} has no automatic value: give one")
        return None
    for member in members:
        made = _as(value, member)
        if made is not None:
            return _in_range(made, f, key)
    wanted = " or ".join("auto" if m is type(None) else "a list" if typing.get_origin(m) is tuple else m.__name__ for m in members)
    raise UsageError(f"{key} = {value!r}: expected {wanted}")


def _as(value: Any, member: Any) -> Any:
    if typing.get_origin(member) is tuple:
        inner = typing.get_args(member)
        value = (value,) if isinstance(value, str) else value  # a list of one
        if not isinstance(value, (list, tuple)) or (Ellipsis not in inner and len(value) != len(inner)):
            return None
        kinds = (inner[0],) * len(value) if Ellipsis in inner else inner
        made = tuple(_as(v, k) for v, k in zip(value, kinds, strict=True))
        return None if any(v is None for v in made) else made
    if member is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if member is str and isinstance(value, int | float) and not isinstance(value, bool):
        return str(value)
    return value if type(value) is member else None


def _in_range(value: Any, f: dataclasses.Field[Any], key: str) -> Any:
    doc = f.metadata
    choices, low, high = doc.get("choices") or (), doc.get("minimum"), doc.get("maximum")
    if choices:
        _require_choice(value, choices, key)
    numbers = value if isinstance(value, tuple) else (value,)
    for number in numbers:
        if isinstance(number, int | float) and not isinstance(number, bool):
            require(math.isfinite(number), UsageError, f"{key} = {value}: must be finite")
            require(low is None or number >= low, UsageError, f"{key} = {value}: the least allowed is {low}")
            require(high is None or number <= high, UsageError, f"{key} = {value}: the most allowed is {high}")
    return value


def _require_choice(value: Any, choices: Sequence[str], key: str) -> None:
    near = difflib.get_close_matches(str(value), choices, n=1)
    says = f"{key} = {value!r}: use one of {', '.join(filter(None, choices))}" + (f"; did you mean {near[0]!r}?" if near else "")
    require(value in choices, UsageError, says)


# ------------------------------------------------------------------ writing


def to_toml(config: Config | None = None, *, comments: bool = True) -> str:
    """The whole configuration as TOML; with `comments`, each key under its own explanation."""
    lines: list[str] = []
    if comments:
        lines += ["# scan2fea configuration. Lengths are metres unless a key says otherwise; auto = decided from the data.", ""]
    _write_table(config or Config(), "", lines, comments)
    lines += table_lines((config or Config()).object, comments)
    return "\n".join(lines).strip() + "\n"


def _write_table(node: Any, prefix: str, lines: list[str], comments: bool) -> None:
    fields = [f for f in dataclasses.fields(node) if prefix or f.name != OBJECTS]
    leaves = [f for f in fields if not dataclasses.is_dataclass(getattr(node, f.name))]
    if prefix and leaves:
        lines.append(f"[{prefix}]")
    for f in leaves:
        if comments and f.metadata.get("doc"):
            lines.append(f"# {_explain(f)}")
        lines.append(f"{f.name} = {_toml_text(getattr(node, f.name))}")
    if leaves:
        lines.append("")
    for f in fields:
        if f not in leaves:
            _write_table(getattr(node, f.name), f"{prefix}.{f.name}" if prefix else f.name, lines, comments)


def _explain(f: dataclasses.Field[Any]) -> str:
    doc = f.metadata
    text = " ".join(str(doc["doc"]).split())
    if doc.get("unit"):
        text += f" [{doc['unit']}]"
    if doc.get("choices"):
        text += " (" + " | ".join(f'"{c}"' for c in doc["choices"]) + ")"
    return text


def _toml_text(value: Any) -> str:
    if value is None:
        return f'"{AUTO}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml_text(v) for v in value) + "]"
    escaped = str(value).replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'


def as_tree(options: Any) -> dict[str, Any]:
    """Options as plain values for report.json, hashes and child processes."""
    return dataclasses.asdict(options)


def from_tree(tree: Mapping[str, Any]) -> Config:
    """The inverse of `as_tree` for a whole Config."""
    return with_settings(Config(), {key: tuple(v) if isinstance(v, list) else v for key, v in _flat(tree)})
