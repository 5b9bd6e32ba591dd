"""`scan2fea config`."""

from __future__ import annotations

import argparse

from scan2fea.cli.settings import config_of
from scan2fea.pipeline.config import to_toml


def execute(given: argparse.Namespace) -> int:
    print(to_toml(config_of(given)), end="")
    return 0
