"""Where the real scans lie, and what becomes of a test without them: it is skipped, saying so; in CI it runs, and fails."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("SCAN2FEA_DATA", Path(__file__).parents[2] / "shared" / "data")).resolve()
IN_CI = bool(os.environ.get("CI"))


def needs(*parts: str) -> pytest.MarkDecorator:
    """Marks a test that reads this file or folder of the real scans."""
    missing = not DATA.joinpath(*parts).exists() and not IN_CI
    return pytest.mark.skipif(missing, reason=f"{'/'.join(parts) or 'the real scans'}: not here; set SCAN2FEA_DATA to the folder of the real scans")
