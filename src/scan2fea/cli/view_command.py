"""`scan2fea view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from scan2fea.viewer import open_report


def execute(given: argparse.Namespace) -> int:
    print(open_report(Path(given.out)))
    return 0
