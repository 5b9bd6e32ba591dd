"""Filters: they mark and thin, and say how (see docs/design.md)."""

from scan2fea.filtering.clean_up import Cleaned, clean_up
from scan2fea.filtering.downsample import Downsampled, downsample
from scan2fea.filtering.fill_behind import Behind, fill_behind
from scan2fea.filtering.options import FilteringOptions
from scan2fea.filtering.outliers import METHODS, Outliers, outliers

__all__ = ["METHODS", "Behind", "Cleaned", "Downsampled", "FilteringOptions", "Outliers", "clean_up", "downsample", "fill_behind", "outliers"]
