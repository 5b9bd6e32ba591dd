"""Sensor fusion on real and simulated logs: errors and speeds, beside other filters where they are installed.

    SCAN2FEA_DATA=DATA python benchmarks/fusion.py [CASE...]        cases: broad navego continuous ximu lab speed

Attitude errors are rotation angles, heading (about the vertical) and inclination apart, as in the evaluation of BROAD. Peers: the wheel `vqf`
where it can be imported, and a Madgwick filter written here from its paper (gradient step, 2011). Nothing is asserted: see docs/fusion.md.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
import time
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from scan2fea.fusion import FusionOptions, complementary, kalman, particle
from scan2fea.io.motion_log import read_inertial
from scan2fea.kernel.geodesy import east_north_up
from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.trajectories import interpolated
from scan2fea.simulation.motion import path_through
from scan2fea.simulation.sensor_logs import LogOptions, sensor_logs
from scan2fea.types import FloatArray, InertialLog, PositionLog, RangeLog, Trajectory


def folder() -> Path:
    return Path(os.environ["SCAN2FEA_DATA"]) / "fusion"


def apart(found: Rotation, truth: Rotation) -> tuple[float, float, float]:
    """RMS degrees: total, heading, inclination of the difference in the world's axes."""
    q = (found * truth.inv()).as_quat()
    total = 2 * np.arccos(np.clip(np.abs(q[:, 3]), 0, 1))
    heading = 2 * np.arctan2(np.abs(q[:, 2]), np.abs(q[:, 3]))
    inclination = 2 * np.arccos(np.clip(np.hypot(q[:, 3], q[:, 2]), 0, 1))
    rms = [math.degrees(math.sqrt(float((e**2).mean()))) for e in (total, heading, inclination)]
    return rms[0], rms[1], rms[2]


def told(name: str, figures: tuple[float, float, float], cpu: float, n: int) -> None:
    print(f"  {name:<34} total {figures[0]:6.2f}  heading {figures[1]:6.2f}  inclination {figures[2]:6.2f} deg   {n / cpu:12,.0f} samples/s")


@jit_ieee
def madgwick(gyr: FloatArray, acc: FloatArray, mag: FloatArray, dt: float, beta: float, q: FloatArray) -> None:
    """Madgwick's filter, q (n, 4) w x y z from the sensor to a world whose x is magnetic north (z up). Gradient by its residuals' Jacobian."""
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    J, f, g = np.zeros((6, 4)), np.zeros(6), np.zeros(4)
    for k in range(len(gyr)):
        a = acc[k] / math.sqrt((acc[k] ** 2).sum())
        m = mag[k] / math.sqrt((mag[k] ** 2).sum())
        hx = 2 * (m[0] * (0.5 - y * y - z * z) + m[1] * (x * y - w * z) + m[2] * (x * z + w * y))
        hy = 2 * (m[0] * (x * y + w * z) + m[1] * (0.5 - x * x - z * z) + m[2] * (y * z - w * x))
        bz = 2 * (m[0] * (x * z - w * y) + m[1] * (y * z + w * x) + m[2] * (0.5 - x * x - y * y))
        bx = math.sqrt(hx * hx + hy * hy)
        f[0], f[1], f[2] = 2 * (x * z - w * y) - a[0], 2 * (w * x + y * z) - a[1], 2 * (0.5 - x * x - y * y) - a[2]
        f[3] = 2 * bx * (0.5 - y * y - z * z) + 2 * bz * (x * z - w * y) - m[0]
        f[4] = 2 * bx * (x * y - w * z) + 2 * bz * (w * x + y * z) - m[1]
        f[5] = 2 * bx * (w * y + x * z) + 2 * bz * (0.5 - x * x - y * y) - m[2]
        J[0, 0], J[0, 1], J[0, 2], J[0, 3] = -2 * y, 2 * z, -2 * w, 2 * x
        J[1, 0], J[1, 1], J[1, 2], J[1, 3] = 2 * x, 2 * w, 2 * z, 2 * y
        J[2, 0], J[2, 1], J[2, 2], J[2, 3] = 0.0, -4 * x, -4 * y, 0.0
        J[3, 0], J[3, 1], J[3, 2], J[3, 3] = -2 * bz * y, 2 * bz * z, -4 * bx * y - 2 * bz * w, -4 * bx * z + 2 * bz * x
        J[4, 0], J[4, 1], J[4, 2], J[4, 3] = -2 * bx * z + 2 * bz * x, 2 * bx * y + 2 * bz * w, 2 * bx * x + 2 * bz * z, -2 * bx * w + 2 * bz * y
        J[5, 0], J[5, 1], J[5, 2], J[5, 3] = 2 * bx * y, 2 * bx * z - 4 * bz * x, 2 * bx * w - 4 * bz * y, 2 * bx * x
        size = 0.0
        for j in range(4):
            g[j] = 0.0
            for i in range(6):
                g[j] += J[i, j] * f[i]
            size += g[j] * g[j]
        size = math.sqrt(size) if size > 0 else 1.0
        u, v, t = gyr[k]
        dw, dx = 0.5 * (-x * u - y * v - z * t) - beta * g[0] / size, 0.5 * (w * u + y * t - z * v) - beta * g[1] / size
        dy, dz = 0.5 * (w * v - x * t + z * u) - beta * g[2] / size, 0.5 * (w * t + x * v - y * u) - beta * g[3] / size
        w, x, y, z = w + dt * dw, x + dt * dx, y + dt * dy, z + dt * dz
        s = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w * s, x * s, y * s, z * s
        q[k, 0], q[k, 1], q[k, 2], q[k, 3] = w, x, y, z


def timed(verb):  # type: ignore[no-untyped-def]
    """Result and the least CPU seconds of three runs after one to compile."""
    made, best = verb(), math.inf
    for _ in range(3):
        started = time.process_time()
        made = verb()
        best = min(best, time.process_time() - started)
    return made, best


def broad() -> None:
    data = loadmat(next((folder() / "broad").glob("*.mat")))
    rate, n = float(data["sampling_rate"].ravel()[0]), len(data["imu_gyr"])
    gyr, acc, mag = (np.ascontiguousarray(data[name]) for name in ("imu_gyr", "imu_acc", "imu_mag"))
    log = InertialLog(time_s=np.arange(n) / rate, rate=gyr, force=acc, magnetic=mag, is_gap=np.zeros(n, bool))
    rows = np.isfinite(data["opt_quat"]).all(axis=1) & (data["movement"].ravel() > 0)
    truth = Rotation.from_quat(data["opt_quat"][rows][:, [1, 2, 3, 0]])
    print(f"broad, {n} rows at {rate:.1f} Hz, {rows.mean():.0%} of them moving with a reference")
    for tau in (3.0, 1.5, 6.0):
        found, cpu = timed(lambda tau=tau: complementary(log, FusionOptions(tau_s=tau)))
        told(f"ours, alpha filter, tau {tau:g} s", apart(Rotation.from_matrix(found.trajectory.T_world_frame[rows, :3, :3]), truth), cpu, n)
    q = np.empty((n, 4))
    for beta in (0.1, 0.05):
        _, cpu = timed(lambda beta=beta: madgwick(gyr, acc, mag, 1 / rate, beta, q))
        north_x = Rotation.from_quat(q[rows][:, [1, 2, 3, 0]])
        told(f"Madgwick, beta {beta:g}", apart(Rotation.from_euler("z", 90, degrees=True) * north_x, truth), cpu, n)
    if importlib.util.find_spec("vqf"):
        import vqf

        made, cpu = timed(lambda: vqf.VQF(1 / rate).updateBatch(gyr, acc, mag))
        told("vqf wheel", apart(Rotation.from_quat(made["quat9D"][rows][:, [1, 2, 3, 0]]), truth), cpu, n)


def ned(euler_rpy: FloatArray) -> Rotation:
    """From the body (forward, right, down) to north, east, down."""
    return Rotation.from_euler("ZYX", euler_rpy[:, ::-1])


def navego() -> None:
    at = folder() / "navego_synth"
    imu, gnss, ref = (loadmat(at / f"{name}.mat", squeeze_me=True, struct_as_record=False)[name] for name in ("imu2", "gnss", "ref"))
    turn = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # north east down <-> east north up; forward right down <-> right forward up
    t = np.asarray(imu.t, float)
    log = InertialLog(time_s=t, rate=imu.wb @ turn.T, force=imu.fb @ turn.T, is_gap=np.zeros(len(t), bool))
    origin = np.array([gnss.lat[0], gnss.lon[0], gnss.h[0]])
    sigma = np.tile(np.asarray(gnss.stdm, float)[[1, 0, 2]], (len(gnss.t), 1))
    gps = PositionLog(time_s=np.asarray(gnss.t, float), position=east_north_up(gnss.lat, gnss.lon, gnss.h, origin), sigma_m=sigma, origin=origin)
    lever = tuple((turn @ np.asarray(gnss.larm, float)).tolist()) if hasattr(gnss, "larm") else (0.0, 0.0, 0.0)
    options = FusionOptions(antenna_m=lever)
    started = time.process_time()
    found = kalman(log, gps, options=options)
    cpu = time.process_time() - started
    place = east_north_up(ref.lat, ref.lon, ref.h, origin)
    body = Rotation.from_euler("ZYX", np.column_stack([ref.yaw, ref.pitch, ref.roll]))
    world = np.einsum("ij,kjl,ml->kim", turn, body.as_matrix(), turn)
    truth = Trajectory(T_world_frame=np.tile(np.eye(4), (len(place), 1, 1)), placed=np.ones(len(place), bool), time_s=np.asarray(ref.t, float))
    T = truth.T_world_frame.copy()
    T[:, :3, :3], T[:, :3, 3] = world, place
    truth = Trajectory(T_world_frame=T, placed=truth.placed, time_s=truth.time_s)
    print(f"navego_synth, {len(t)} rows over {t[-1] - t[0]:.0f} s, {len(gps)} positions of {sigma[0]} m; {cpu:.1f} cpu s with compilation")
    print("  taken:", dict(found.taken), "heading told:", found.is_heading_told)
    for name, way in (("filter", found.filtered), ("smoothed", found.trajectory)):
        report(name, way, truth, skip_s=60.0)


def report(name: str, way: Trajectory, truth: Trajectory, skip_s: float = 0.0) -> None:
    time_s = way.time_s
    assert time_s is not None and truth.time_s is not None
    rows = (time_s >= max(truth.time_s[0], time_s[0] + skip_s)) & (time_s <= truth.time_s[-1])
    right = interpolated(truth, time_s[rows]).T_world_frame
    found = way.T_world_frame[rows]
    turn = Rotation.from_matrix(right[:, :3, :3]) * Rotation.from_matrix(found[:, :3, :3]).inv()
    error = np.c_[right[:, :3, 3] - found[:, :3, 3], turn.as_rotvec()]
    total, heading, inclination = apart(Rotation.from_matrix(found[:, :3, :3]), Rotation.from_matrix(right[:, :3, :3]))
    place = np.sqrt((error[:, :3] ** 2).mean(axis=0))
    print(f"  {name:<10} after {skip_s:.0f} s: place rms {place.round(3)} m;", end=" ")
    print(f"total {total:.3f}, heading {heading:.3f}, inclination {inclination:.3f} deg", end="")
    if way.covariance is not None:
        P = way.covariance[rows]
        square = np.einsum("ki,ki->k", error, np.linalg.solve(P, error[:, :, None])[:, :, 0])
        own = [np.einsum("ki,ki->k", error[:, s], np.linalg.solve(P[:, s, s], error[:, s][:, :, None])[:, :, 0]) for s in (slice(0, 3), slice(3, 6))]
        shares = [(square < chi2.ppf(0.95, 6)).mean(), *((o < chi2.ppf(0.95, 3)).mean() for o in own)]
        print(f"; in the 95 % ellipse: all {shares[0]:.1%}, place {shares[1]:.1%}, turn {shares[2]:.1%}; nees/6 {square.mean() / 6:.2f}", end="")
    print()


def continuous() -> None:
    """Without a magnetometer the heading is free: the inclination alone is compared, and the whole attitude where odometry helps."""
    raw, way = np.loadtxt(folder() / "continuous" / "imu.txt"), np.loadtxt(folder() / "continuous" / "traj.txt")
    log = InertialLog(time_s=raw[:, 0], rate=raw[:, 4:7], force=raw[:, 1:4], is_gap=np.concatenate([[False], np.diff(raw[:, 0]) > 0.1]))
    T = homogeneous(Rotation.from_quat(way[:, 4:8]).as_matrix())
    T[:, :3, 3] = way[:, 1:4]
    truth = Trajectory(T_world_frame=T, placed=np.ones(len(way), bool), time_s=way[:, 0])
    print(f"continuous, {len(log)} rows over {raw[-1, 0] - raw[0, 0]:.0f} s; reference: LiDAR odometry, its vertical and the mounting are fitted")
    inside = (way[:, 0] > raw[0, 0] + 5) & (way[:, 0] < raw[-1, 0])
    right = T[inside, :3, :3]

    def at(R: FloatArray) -> FloatArray:
        whole = Trajectory(T_world_frame=homogeneous(R), placed=np.ones(len(R), bool), time_s=raw[:, 0])
        return interpolated(whole, way[inside, 0]).T_world_frame[:, :3, :3]

    inclined("ours, alpha filter", at(complementary(log).trajectory.T_world_frame[:, :3, :3]), right)
    if importlib.util.find_spec("vqf"):
        import vqf

        step = float(np.median(np.diff(raw[:, 0])))
        made = vqf.VQF(step).updateBatch(np.ascontiguousarray(log.rate), np.ascontiguousarray(log.force))
        inclined("vqf wheel", at(Rotation.from_quat(made["quat6D"][:, [1, 2, 3, 0]]).as_matrix()), right)
    started = time.process_time()
    fused = kalman(log, odometry=truth)
    print(f"  ours, Kalman with its steps: scale {fused.scale}, taken {dict(fused.taken)}, {time.process_time() - started:.1f} cpu s")
    mine = interpolated(fused.trajectory, way[inside, 0]).T_world_frame[:, :3, :3]
    aligned("ours, Kalman, odometry steps", mine, right)


def homogeneous(R: FloatArray) -> FloatArray:
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3] = R
    return T


def aligned(name: str, found: FloatArray, truth: FloatArray) -> None:
    """Errors after one turn of the world and one of the mounting, both by least squares in turn (A found B = truth)."""
    A, B = Rotation.identity(), Rotation.identity()
    mine, right = Rotation.from_matrix(found), Rotation.from_matrix(truth)
    for _ in range(50):
        A = (right * (mine * B).inv()).mean()
        B = ((A * mine).inv() * right).mean()
    error = ((A * mine * B) * right.inv()).as_rotvec(degrees=True)
    up = A.apply([0.0, 0.0, 1.0])  # our vertical in the world of the reference
    heading = error @ up
    tilt = np.linalg.norm(error - heading[:, None] * up, axis=1)
    rms = [float(np.sqrt((part**2).mean())) for part in (np.linalg.norm(error, axis=1), heading, tilt)]
    print(f"  {name:<34} total {rms[0]:6.2f}  heading {rms[1]:6.2f}  inclination {rms[2]:6.2f} deg; mounting {np.degrees(B.magnitude()):.2f} deg")


def inclined(name: str, found: FloatArray, truth: FloatArray) -> None:
    """Angle between the vertical as the filter has it and one fixed direction of the reference's world, both in the body."""
    mine, up, B = found[:, 2, :].copy(), np.array([0.0, 0.0, 1.0]), Rotation.identity()
    for _ in range(50):
        up = np.einsum("kij,kj->i", truth, B.apply(mine))
        up /= np.linalg.norm(up)
        B = Rotation.align_vectors(np.einsum("kji,j->ki", truth, up), mine)[0]
    angle = np.degrees(np.arccos(np.clip((B.apply(mine) * np.einsum("kji,j->ki", truth, up)).sum(axis=1), -1, 1)))
    print(f"  {name:<34} tilt {np.sqrt((angle**2).mean()):.2f} deg rms, largest {angle.max():.2f}; mounting {np.degrees(B.magnitude()):.2f} deg")


def ximu() -> None:
    read = read_inertial(folder() / "ximu" / "sensor_data.csv")
    found = complementary(read.value)
    tilt = Rotation.from_matrix(found.trajectory.T_world_frame[[0, -1], :3, :3]).as_euler("ZYX", degrees=True)
    print(f"ximu, {len(read.value)} rows, notes {read.notes}: yaw, pitch, roll first {tilt[0].round(2)} last {tilt[1].round(2)} deg;", end=" ")
    print(f"at rest {found.is_rest.mean():.0%}, bias {np.degrees(found.bias[-1]).round(3)} deg/s, disturbed field {found.n_disturbed} rows")


def lab() -> None:
    """Kidnapped starts in the simulated lab, as tests/fusion/test_particle.py has them, with other seeds."""
    spec = importlib.util.spec_from_file_location("lost_in_the_lab", Path(__file__).parents[1] / "tests" / "fusion" / "test_particle.py")
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    good, first, error = 0, [], []
    for seed in range(100, 140):
        poses = made.way(seed, 60)
        log, odometry = made.seen(poses, seed)
        located = particle(log, made.MAP, odometry, FusionOptions(seed=seed))
        off = made.off(located, poses)[50:]
        right = bool((np.linalg.norm(off[:, :2], axis=1) < 0.1).all() and (np.abs(off[:, 2]) < np.radians(5)).all())
        good += right
        if right:
            error.append(off)
        first.append(located.found_s)
    rms = np.sqrt((np.concatenate(error) ** 2).mean(axis=0))
    print(f"lab: {good} of 40 kidnapped starts right after 5 s; first sure after {np.nanmedian(first):.1f} s (median);", end=" ")
    print(f"rms {rms[:2]} m, {math.degrees(rms[2]):.2f} deg")


def speed() -> None:
    rng = np.random.default_rng(0)
    n = 1_000_000
    log = InertialLog(
        time_s=np.arange(n) / 200.0, rate=rng.normal(0, 0.3, (n, 3)), force=rng.normal(0, 0.5, (n, 3)) + np.array([0, 0, 9.8]),
        magnetic=rng.normal(0, 1, (n, 3)) + np.array([0, 20, -40]), is_gap=np.zeros(n, bool),
    )  # fmt: skip
    _, cpu = timed(lambda: complementary(log))
    print(f"speed: alpha filter with magnetometer {n / cpu:,.0f} samples/s")
    if importlib.util.find_spec("vqf"):
        import vqf

        _, cpu = timed(lambda: vqf.VQF(0.005).updateBatch(log.rate.copy(), log.force.copy(), np.ascontiguousarray(log.magnetic)))
        print(f"speed: vqf wheel {n / cpu:,.0f} samples/s")
    t = np.linspace(0.0, 300.0, 151)
    turn = np.c_[rng.uniform(-15, 15, (151, 2)), np.cumsum(rng.uniform(-30, 40, 151))]
    path = path_through(t, np.cumsum(rng.normal(size=(151, 3)) * np.array([2, 2, 0.3]), axis=0), turn)
    logs = sensor_logs(path, LogOptions(), 0)
    inertial = InertialLog(time_s=logs.imu.time_s, rate=logs.imu.rate, force=logs.imu.force, is_gap=np.zeros(len(logs.imu.time_s), bool))
    gps = PositionLog(time_s=logs.gps.time_s, position=logs.gps.position, sigma_m=logs.gps.sigma_m)
    for hz in (100.0, 20.0):
        _, cpu = timed(lambda hz=hz: kalman(inertial, gps, options=FusionOptions(rate_hz=hz)))
        print(f"speed: Kalman filter and smoother, {hz:g} poses a second: {len(inertial) / cpu:,.0f} inertial samples/s")
    # 180 returns a sweep: a room of four walls
    angle = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    with np.errstate(divide="ignore"):
        wall = np.minimum(4.0 / np.abs(np.cos(angle)), 3.0 / np.abs(np.sin(angle)))
    side = np.linspace(-1, 1, 801)
    three = np.full(801, 3.0)
    walls = np.concatenate([np.c_[4 * side, three], np.c_[4 * side, -three], np.c_[three + 1, 3 * side], np.c_[-three - 1, 3 * side]])
    sweeps = 200
    ranges = RangeLog(
        time_s=np.repeat(np.arange(sweeps) / 10.0, 180), angle=np.tile(angle, sweeps), range_m=np.tile(wall, sweeps),
        first=np.arange(sweeps + 1, dtype=np.int64) * 180,
    )  # fmt: skip
    T = np.tile(np.eye(4), (sweeps, 1, 1))
    still = Trajectory(T_world_frame=T, placed=np.ones(sweeps, bool), time_s=np.arange(sweeps) / 10.0)
    located, cpu = timed(lambda: particle(ranges, walls, still))
    middle = np.median(located.n_particles)
    print(f"speed: particle filter, median {middle:.0f} particles x 180 rays, start from nowhere included: {cpu / sweeps * 1e3:.2f} cpu ms a sweep")


CASES = {"broad": broad, "navego": navego, "continuous": continuous, "ximu": ximu, "lab": lab, "speed": speed}

if __name__ == "__main__":
    for name in sys.argv[1:] or CASES:
        CASES[name]()
