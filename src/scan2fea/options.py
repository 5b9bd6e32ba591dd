"""How a stage declares its options: a frozen dataclass whose fields carry their own documentation.

The TOML of `scan2fea config`, the validation of `--set` and the report read these declarations; nothing is written twice.
"""

from __future__ import annotations

import dataclasses
from typing import Any


def option(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    choices: tuple[str, ...] = (),
    minimum: float | None = None,
    maximum: float | None = None,
) -> Any:
    """A dataclass field with its documentation, unit, choices and closed range; `None` as default means "from the data"."""
    metadata = {"doc": doc, "unit": unit, "choices": choices, "minimum": minimum, "maximum": maximum}
    return dataclasses.field(default=default, metadata=metadata)
