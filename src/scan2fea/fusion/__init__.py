"""Logs of motion sensors to one trajectory (see docs/fusion.md)."""

from scan2fea.fusion.complementary import Attitude, complementary
from scan2fea.fusion.kalman import Motion, Taken, kalman
from scan2fea.fusion.options import FusionOptions
from scan2fea.fusion.particle import Located, particle
from scan2fea.fusion.plausible import require_unit

__all__ = ["Attitude", "FusionOptions", "Located", "Motion", "Taken", "complementary", "kalman", "particle", "require_unit"]
