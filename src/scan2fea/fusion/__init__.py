"""Logs of motion sensors to one trajectory (see docs/fusion.md)."""

from scan2fea.fusion.complementary import Attitude, complementary
from scan2fea.fusion.kalman import Motion, Taken, kalman
from scan2fea.fusion.options import FusionOptions

__all__ = ["Attitude", "FusionOptions", "Motion", "Taken", "complementary", "kalman"]
