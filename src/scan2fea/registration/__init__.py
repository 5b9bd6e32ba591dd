"""Inputs into one frame (see docs/design.md and docs/registration.md)."""

from scan2fea.registration.motion import at_times, deskewed, deskewed_by, moved
from scan2fea.registration.odometry import Odometry, odometry
from scan2fea.registration.options import RegistrationOptions
from scan2fea.registration.place import Placed, joined, place
from scan2fea.registration.poses import read_poses, read_trajectory
from scan2fea.registration.register import Link
from scan2fea.registration.sweeps import VISIBLE, Sweeps, has_changed
from scan2fea.registration.uncertainty import pose_variance

__all__ = [
    "VISIBLE",
    "Link",
    "Odometry",
    "Placed",
    "RegistrationOptions",
    "Sweeps",
    "at_times",
    "deskewed",
    "deskewed_by",
    "has_changed",
    "joined",
    "moved",
    "odometry",
    "place",
    "pose_variance",
    "read_poses",
    "read_trajectory",
]
