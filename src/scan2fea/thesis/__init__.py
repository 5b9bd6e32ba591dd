"""The source thesis's tables and figures by their own numbers, from our code (see docs/thesis.md). The rooms that it calls know nothing of it."""

from scan2fea.thesis.bench import ThesisOptions
from scan2fea.thesis.registry import EXPERIMENTS
from scan2fea.thesis.run import run_thesis

__all__ = ["EXPERIMENTS", "ThesisOptions", "run_thesis"]
