"""What a user can say about sensors that do not return points."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class AcquisitionOptions:
    """Photographs, stereo pairs, depth images and ultrasonic logs (docs/acquisition.md)."""

    sensor: str = option("", "What a log or scan was taken with, where the file cannot tell", choices=("", "ultrasonic"))
    calibration: str = option(
        "", "Cameras: a file (OpenCV yml or xml, Middlebury calib.txt, calibration.json of a run, intrinsics json), or a folder of chessboard pairs"
    )
    board: str = option("", 'Chessboard of a folder of calibration: inner corners and side of a square, "9x6 25 mm"')
    scale: str = option("", 'Length that photographs do not tell: "0.25 m between targets A B" or "1.2 m between cameras 01.jpg 02.jpg"')
    known_length: str = option("", 'The same between two places of one photograph, pixels: "0.8 m 03.jpg 120,340 810,355"')
    max_px: int = option(1600, "Longer side of a photograph when depths are matched; larger ones are reduced", unit="px", minimum=200)
    neighbours: int = option(3, "Other photographs that each one is matched with", minimum=1)
    depth_per_m: float = option(1000.0, "Grey values of a depth image per metre", minimum=1e-3)
    max_depth_m: float = option(5.0, "Farther values of a depth camera are left out: its error grows with the square of the distance", minimum=0.1)
    cone_deg: float | None = option(
        None, "Full opening of an ultrasonic cone; auto: what the log says, else 30", unit="deg", minimum=0.5, maximum=120.0
    )
    seed: int = option(0, "Seed of the samples by which wrong matches of photographs are told", minimum=0)
