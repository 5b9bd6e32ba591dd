"""Inputs into one frame (see docs/design.md and docs/registration.md)."""

from scan2fea.registration.options import RegistrationOptions
from scan2fea.registration.place import Placed, joined, place
from scan2fea.registration.poses import read_poses
from scan2fea.registration.register import Link

__all__ = ["Link", "Placed", "RegistrationOptions", "joined", "place", "read_poses"]
