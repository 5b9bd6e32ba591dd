"""What a user can say about where the inputs stand."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class RegistrationOptions:
    """Where the inputs stand relative to each other."""

    mode: str = option(
        "auto",
        "auto: poses that files or `poses` give and inputs that already agree are kept (see `correct`); the rest is registered. "
        "placed: all stay where their files or `poses` put them. free: all are registered, whatever their files say",
        choices=("auto", "placed", "free"),
    )
    correct: bool = option(
        False, "Move inputs that have a place where their surfaces say otherwise; things that are round, slender or alike along a line may mislead it"
    )
    poses: str = option("", "File with the pose of each input (bun.conf, graph.txt, TUM, KITTI, 4 x 4 matrices, .npy); empty: as they lie")
    calibration: str = option("", "calib.txt of KITTI, which takes the scans to the camera that `poses` are of; empty: `poses` are of the scans")
    sweeps: str = option(
        "auto",
        "Of a capture of many turns. auto: odometry where more than 4 % of its beams end elsewhere in the end, else as_they_lie. as_they_lie: "
        "one cloud in the frame of the scanner, right where it stood; odometry: its motion is searched, and used where forwards and backwards "
        "agree. A TUM file of `poses` with the capture's times is used in any case",
        choices=("auto", "as_they_lie", "odometry"),
    )
    seed: int = option(0, "Seed of the triples of matches that are drawn", minimum=0)
