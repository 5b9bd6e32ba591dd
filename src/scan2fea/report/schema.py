"""The published JSON Schema of report.json, and reading a report.json without trusting it."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any, NoReturn

from scan2fea.errors import FormatError, InputError

SCHEMA_FILE = "report.schema.json"


def report_schema() -> dict[str, Any]:
    """The schema (draft 2020-12) as a dictionary; any validator of that draft can use it."""
    text = resources.files("scan2fea.report").joinpath(SCHEMA_FILE).read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def parse_report(text: str) -> dict[str, Any]:
    """report.json from its text. JSON has no NaN and no infinity: they are refused, not read.

    Raises FormatError.
    """

    def refuse(word: str) -> NoReturn:
        raise FormatError(f"report.json holds {word}, which is not JSON: write null for a value that is not known")

    try:
        report = json.loads(text, parse_constant=refuse)
    except ValueError as error:
        raise FormatError(f"report.json is not JSON: {error}; run the conversion again (with --resume nothing is computed twice)") from error
    if not isinstance(report, dict):
        raise FormatError(f"report.json holds a {type(report).__name__}, not an object; run the conversion again")
    return report


def read_report(out: Path) -> dict[str, Any]:
    """`out`/report.json. Raises InputError where there is none, FormatError where it is damaged."""
    path = out / "report.json"
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: {out} is not the output of a finished `scan2fea run`") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from error
    return parse_report(text)
