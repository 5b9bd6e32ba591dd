"""Estimation: points of a member of known kind to its dimensions, with what the data can and cannot tell."""

from scan2fea.estimation.fit import FitOptions, SectionFit, fit_section
from scan2fea.estimation.scoring import Scored, maximise

__all__ = ["FitOptions", "Scored", "SectionFit", "fit_section", "maximise"]
