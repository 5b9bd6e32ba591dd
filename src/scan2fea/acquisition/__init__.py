"""Sensors that do not return points: photographs, stereo pairs, depth images, ultrasonic logs. Every one hands on frames with their uncertainty."""

from __future__ import annotations

from scan2fea.acquisition.acquired import Acquired, Frame
from scan2fea.acquisition.images import is_image
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.photographs import from_photographs
from scan2fea.acquisition.rgbd import from_rgbd, is_rgbd
from scan2fea.acquisition.stereo import from_stereo
from scan2fea.acquisition.ultrasonic import from_ultrasonic

__all__ = ["Acquired", "AcquisitionOptions", "Frame", "from_photographs", "from_rgbd", "from_stereo", "from_ultrasonic", "is_image", "is_rgbd"]
