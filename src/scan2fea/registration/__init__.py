"""Inputs into one frame (see docs/design.md)."""

from scan2fea.registration.place import Placed, RegistrationOptions, joined, place
from scan2fea.registration.poses import read_poses

__all__ = ["Placed", "RegistrationOptions", "joined", "place", "read_poses"]
