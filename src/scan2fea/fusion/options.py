"""What a user can say about the sensors that tell a motion."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class FusionOptions:
    """How logs of motion sensors become one trajectory."""

    method: str = option(
        "kalman",
        "kalman: place and attitude from inertial data with satellite positions, odometry or poses, smoothed over the whole log. "
        "complementary: attitude alone, from inertial data. particle: place on a known map from ranges in a plane",
        choices=("complementary", "kalman", "particle"),
    )
    imu: str = option("", "Log of the inertial unit (csv with a line of names); of `run`: the scanner's motion is told by it")
    gps: str = option("", "Log of a satellite receiver (csv with a line of names, or NMEA)")
    odometry: str = option("", "Poses (TUM) of which only the steps from one to the next are believed")
    poses: str = option("", "Poses (TUM) of the inertial unit in the world, e.g. of a camera or of LiDAR odometry that was placed")
    map: str = option("", "Scan of the place (particle)")
    angle_unit: str = option("auto", "Of the rates of the inertial log; auto: as its names say, else rad unless only degrees can be meant",
                             choices=("auto", "rad", "deg"))  # fmt: skip
    tau_s: float = option(3.0, "Time constant after which the accelerometer outweighs the gyroscope (complementary)", unit="s", minimum=0.01)
    magnetic_tau_s: float = option(9.0, "The same of the magnetometer's heading", unit="s", minimum=0.01)
    bias_tau_s: float = option(60.0, "Time constant of the gyro bias while the unit moves", unit="s", minimum=1.0)
    gyro_noise: float | None = option(None, "White noise of the rates; auto: from the log", unit="rad/s/sqrt(Hz)", minimum=0.0)
    acceleration_noise: float | None = option(None, "White noise of the specific force; auto: from the log", unit="m/s^2/sqrt(Hz)", minimum=0.0)
    gyro_bias: float = option(1e-2, "Standard deviation of the bias of the rates at the start", unit="rad/s", minimum=1e-9)
    acceleration_bias: float = option(0.1, "Standard deviation of the bias of the specific force", unit="m/s^2", minimum=1e-9)
    gyro_walk: float = option(2e-5, "Random walk of the bias of the rates", unit="rad/s^2/sqrt(Hz)", minimum=0.0)
    acceleration_walk: float = option(5e-4, "Random walk of the bias of the specific force", unit="m/s^3/sqrt(Hz)", minimum=0.0)
    gps_m: float | None = option(None, "Standard deviation of a satellite position east and north, twice that upwards; auto: the log's", minimum=1e-6)
    antenna_m: tuple[float, float, float] = option((0.0, 0.0, 0.0), "Where the antenna is, in the axes of the inertial unit", unit="m")
    scanner_m: tuple[float, float, float] = option((0.0, 0.0, 0.0), "Where the scanner is, in the axes of the inertial unit (run)", unit="m")
    scanner_deg: tuple[float, float, float] = option(
        (0.0, 0.0, 0.0), "How the scanner is turned to it: roll about x, then pitch about y, then yaw about z (run)", unit="deg"
    )
    odometry_m: float = option(0.01, "Random error of the odometry after one metre; grows with the root of the way", unit="m/sqrt(m)", minimum=1e-6)
    odometry_scale: float = option(0.01, "Standard deviation of the scale of the odometry", minimum=1e-6)
    pose_m: float = option(0.02, "Standard deviation of the places of `poses`", unit="m", minimum=1e-6)
    pose_deg: float = option(0.2, "Standard deviation of their turns", unit="deg", minimum=1e-6)
    gate: float = option(1e-4, "A measurement that chance gives less often than this is left out and counted", minimum=0.0, maximum=0.5)
    rate_hz: float = option(100.0, "Poses written per second; fewer where they would be more than a hundred thousand", unit="Hz", minimum=0.1)
    particles: int = option(1000, "Particles once the place is known", minimum=10)
    map_low_m: float | None = option(None, "Lowest height of the map's points that the scanner's plane meets; auto: all points", unit="m")
    map_high_m: float | None = option(None, "Highest such height", unit="m")
    range_m: float = option(0.05, "Standard deviation of ranges and map together", unit="m", minimum=1e-4)
    seed: int = option(0, "Seed of the particles", minimum=0)
