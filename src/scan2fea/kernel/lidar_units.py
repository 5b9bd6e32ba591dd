"""Rotating LiDAR units as their makers describe them: what a simulator needs to imitate one, and a reader to decode it.

Sources: user manuals of the HDL-32E and the VLP-16 (elevations, order and times of firing; the vertical offsets of the VLP-16 table are
41.91 mm tan(elevation)); the crossing point of the HDL-32E's beams as velodyne-decoder 3.1 applies it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LidarUnit:
    """factory : the byte that names it in its packets.   elevations_deg : in firing order.

    focal_m : from the turning axis to where all beams cross.   firing_us, laser_us : from one firing to the next, from one laser to the next.
    """

    name: str
    factory: int
    elevations_deg: tuple[float, ...]
    focal_m: float
    firing_us: float
    laser_us: float


# the lower and the upper half of the fan take turns: -30.67, -9.33, -29.33, -8.00, ..., -10.67, 10.67
HDL32E = LidarUnit("HDL-32E", 0x21, tuple(round((i // 2 + 16 * (i % 2) - 23) * 4 / 3, 2) for i in range(32)), 0.02895, 46.08, 1.152)
# -15, 1, -13, 3, ..., -1, 15
VLP16 = LidarUnit("VLP-16", 0x22, tuple(float(i - 15 if i % 2 == 0 else i) for i in range(16)), 0.04191, 55.296, 2.304)
