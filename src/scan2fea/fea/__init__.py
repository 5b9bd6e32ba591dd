"""Finite elements: materials, model, embedded solver, decks (see docs/design.md)."""

from scan2fea.fea.bdf import write_bdf
from scan2fea.fea.deck import write_inp
from scan2fea.fea.loads import parse_loads, parse_supports
from scan2fea.fea.materials import MATERIALS, material
from scan2fea.fea.model import ALL, LOWEST, build_model, check_options
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.solve import solve

__all__ = [
    "ALL", "LOWEST", "MATERIALS", "FeaOptions", "build_model", "check_options", "material", "parse_loads", "parse_supports", "solve", "write_bdf",
    "write_inp",
]  # fmt: skip
