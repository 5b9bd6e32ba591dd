"""The only place where a name becomes a sensor: adding one is a file and a line here.

A sensor is a frozen dataclass of options and a verb `scan(scene, options, seed) -> tuple[Scan, ...]`: one scan per station or frame, points
in the world's frame, `cloud.label` the number of the solid (-1: a false return, of no solid), every ray kept with its origin, direction, range
(nan: nothing came back), and time and ring where the instrument has them. Sensors whose silence says nothing (triangulation, sound) keep
only the rays that returned; a scan without any has no rays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from scan2fea.simulation.laser_scanner import TerrestrialOptions, scan_terrestrial
from scan2fea.simulation.lidar import Hdl32eOptions, LidarOptions, PlanarOptions, Vlp16Options, scan_lidar
from scan2fea.simulation.line_laser import LineLaserOptions, scan_line_laser
from scan2fea.simulation.photogrammetry import PhotogrammetryOptions, SfmOptions, StereoOptions, scan_photogrammetry, scan_stereo, sfm_frame
from scan2fea.simulation.solids import Scene
from scan2fea.simulation.stations import StationsOptions, scan_stations
from scan2fea.simulation.ultrasonic import UltrasonicOptions, scan_ultrasonic
from scan2fea.types import FloatArray, Scan


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """doc : one line for users.   options : the dataclass of its options.   scan : the verb.

    moves : it measures while it travels along its path, so that logs of the way belong to it; otherwise it stands at each position in turn.
    frame : of a sensor that knows neither the world's frame nor metres: options -> pose of the frame of its files, their lengths per metre.
    """

    doc: str
    options: type[Any]
    scan: Callable[[Scene, Any, int], tuple[Scan, ...]]
    moves: bool = False
    frame: Callable[[Any], tuple[FloatArray, float]] | None = None


SENSORS: Mapping[str, Sensor] = {
    "stations": Sensor(
        doc="static scanners that aim at points spread evenly over each object (fast, even coverage)", options=StationsOptions, scan=scan_stations
    ),
    "terrestrial": Sensor(
        doc="terrestrial laser scanner on stations: a grid of equal angles, misses kept", options=TerrestrialOptions, scan=scan_terrestrial
    ),
    "hdl32e": Sensor(doc="Velodyne HDL-32E on a path: 32 beams, one scan per turn", options=Hdl32eOptions, scan=scan_lidar, moves=True),
    "vlp16": Sensor(doc="Velodyne VLP-16 on a path: 16 beams, one scan per turn", options=Vlp16Options, scan=scan_lidar, moves=True),
    "planar": Sensor(doc="single-beam scanner in one plane, on a path", options=PlanarOptions, scan=scan_lidar, moves=True),
    "lidar": Sensor(doc="rotating LiDAR with any table of beams, on a path", options=LidarOptions, scan=scan_lidar, moves=True),
    "line_laser": Sensor(
        doc="line laser scanner on a path: a sheet of light and a camera beside it", options=LineLaserOptions, scan=scan_line_laser, moves=True
    ),
    "photogrammetry": Sensor(
        doc="pictures from two positions or more, solved together: sparse points on texture", options=PhotogrammetryOptions, scan=scan_photogrammetry
    ),
    "sfm": Sensor(
        doc="structure from motion: pictures whose places are not known, the scan in a frame and a scale of its own (truth.json tells both)",
        options=SfmOptions,
        scan=scan_photogrammetry,
        frame=sfm_frame,
    ),
    "stereo": Sensor(doc="a rig of two cameras at each position: sparse points on texture", options=StereoOptions, scan=scan_stereo),
    "ultrasonic": Sensor(
        doc="ultrasonic ranging on a path: the nearest return in a wide cone", options=UltrasonicOptions, scan=scan_ultrasonic, moves=True
    ),
}
