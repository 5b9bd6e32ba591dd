"""Finite elements: materials, model, embedded solver, decks (see docs/design.md)."""

from scan2fea.fea.bdf import write_bdf
from scan2fea.fea.deck import write_inp
from scan2fea.fea.materials import MATERIALS, material
from scan2fea.fea.model import build_model, check_options
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.solve import solve

__all__ = ["MATERIALS", "FeaOptions", "build_model", "check_options", "material", "solve", "write_bdf", "write_inp"]
