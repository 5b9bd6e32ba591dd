"""Registration on real and simulated scans: success, error and CPU seconds, beside other libraries where they are installed.

    SCAN2FEA_DATA=DATA python benchmarks/registration.py [CASE...]        cases: bunny kitti 3dmatch gicp car demo pcl

Peers are used where they can be imported (never in the project's own environment): Open3D and kiss-matcher (pairs without a start), small_gicp and
KISS-ICP (from 4 degrees and 3 edges off).
Nothing is asserted: the figures are in docs/registration.md.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scan2fea.io import read_scan
from scan2fea.kernel.transforms import applied, inverse, random_rotation, rigid, rotation_about
from scan2fea.pipeline.simulate import scanned, scene_named
from scan2fea.registration import RegistrationOptions, place, read_poses
from scan2fea.registration.icp import icp, orthonormal
from scan2fea.registration.quality import judge
from scan2fea.registration.ransac import kabsch
from scan2fea.registration.register import Matcher, register
from scan2fea.registration.surface import Surface, common_edge, surface_of
from scan2fea.types import FloatArray, PointCloud, Scan

FREE = RegistrationOptions(mode="free")
WIDE = 0.3  # overlap above which every pair must be right (issue 9)


def folder() -> Path:
    return Path(os.environ["SCAN2FEA_DATA"]) / "registration"


def bunny() -> tuple[list[Scan], list[FloatArray]]:
    names = [f"bun{a}.ply" for a in ("000", "045", "090", "180", "270", "315")] + ["chin.ply", "ear_back.ply"]
    at = folder() / "stanford_bunny"
    return [read_scan(at / name).scan for name in names], [T for T in read_poses(at / "bun.conf", names) if T is not None]


def kitti() -> tuple[list[Scan], list[FloatArray]]:
    paths = sorted((folder() / "kitti_07").glob("*.bin"))
    scans = [Scan(cloud=PointCloud.of(np.fromfile(path, "<f4").reshape(-1, 3).astype(float))) for path in paths]
    return scans, [T for T in read_poses(folder() / "kitti_07" / "graph.txt", [path.name for path in paths]) if T is not None]


def match3d() -> tuple[list[Scan], list[FloatArray]]:
    at = folder() / "3dmatch_demo"
    return [Scan(cloud=PointCloud.of(np.load(at / name)[:, :3])) for name in ("ref.npy", "src.npy")], [np.eye(4), np.load(at / "gt.npy")]


def gicp_pair() -> tuple[list[Scan], list[FloatArray]]:
    at = folder() / "small_gicp"
    return [read_scan(at / name).scan for name in ("target.ply", "source.ply")], [np.eye(4), np.loadtxt(at / "T_target_source.txt")]


def car() -> tuple[list[Scan], list[FloatArray]]:
    """The reference transform is libpointmatcher's own answer; it takes the first cloud to the second."""
    at = folder() / "libpointmatcher"
    names = ("car_cloud400.csv", "car_cloud401.csv")
    scans = [read_scan(at / name).scan for name in names]
    return scans, [np.eye(4), inverse(np.loadtxt(at / "defaultIdentityDataPointsFilter.ref_trans"))]


def demo() -> tuple[list[Scan], list[FloatArray]]:
    """Thirteen stations of the demo scene, each in a frame of its own."""
    scans = [scan for _, scan in scanned(scene_named("demo", 0), 0)]
    random = np.random.default_rng(5)
    poses = [rigid(random_rotation(k + 1), random.normal(size=3)) for k in range(len(scans))]
    moved = place(scans, [inverse(T) for T in poses], [str(k) for k in range(len(scans))], RegistrationOptions(mode="placed")).scan
    out = []
    for k in range(len(scans)):
        part = Scan(cloud=moved.cloud.take(moved.cloud.frame == k), rays=moved.rays).compact()
        out.append(part)
    return out, poses


def error(T: FloatArray, truth: FloatArray, centre: FloatArray) -> tuple[float, float]:
    """Degrees, and metres at a point of the source."""
    turn = np.degrees(np.arccos(np.clip((np.trace(truth[:3, :3].T @ T[:3, :3]) - 1) / 2, -1, 1)))
    return float(turn), float(np.linalg.norm(applied(T, centre[None]) - applied(truth, centre[None])))


def all_frames(name: str, scans: Sequence[Scan], truth: Sequence[FloatArray]) -> None:
    started = time.process_time()
    found = place(scans, [None] * len(scans), [str(k) for k in range(len(scans))], FREE)
    cpu = time.process_time() - started
    T, placed = found.trajectory.T_world_frame, np.flatnonzero(found.trajectory.placed)
    worst = [error(inverse(T[placed[0]]) @ T[k], inverse(truth[placed[0]]) @ truth[k], scans[k].cloud.points.mean(axis=0)) for k in placed]
    moved = np.concatenate([applied(T[k], scans[k].cloud.points[::20]) for k in placed])
    right = np.concatenate([applied(truth[k], scans[k].cloud.points[::20]) for k in placed])
    rms = np.sqrt(((applied(kabsch(moved[None], right[None])[0], moved) - right) ** 2).sum(axis=1).mean())
    print(f"{name}: {len(placed)} of {len(scans)} placed, worst {max(w[0] for w in worst):.3f} deg {1e3 * max(w[1] for w in worst):.2f} mm,", end=" ")
    print(f"whole {1e3 * rms:.2f} mm rms, largest std {1e3 * np.nanmax(found.std_m):.2f} mm, {cpu:.1f} cpu s")


def pairs(name: str, scans: Sequence[Scan], truth: Sequence[FloatArray]) -> None:
    """Each pair alone, without the help of the others."""
    edge = common_edge([scan.cloud.points for scan in scans])
    surfaces = [surface_of(scan, edge) for scan in scans]
    matcher = Matcher(surfaces, 0)
    rows = []
    for b in range(len(scans)):
        for a in range(b):
            known = inverse(truth[a]) @ truth[b]
            shared = judge(surfaces[b], surfaces[a], matcher.tree(a), known).overlap
            started = time.process_time()
            link = matcher.search(a, b)
            cpu = time.process_time() - started
            accepted = link is not None and link.used
            turn, shift = error(link.T_target_source, known, surfaces[b].points.mean(axis=0)) if link is not None else (np.nan, np.nan)
            rows.append((shared, accepted, turn, shift, cpu))
    table = np.array(rows, float)
    wide = table[:, 0] > WIDE
    good = wide & (table[:, 1] > 0)
    print(f"{name}, pairs alone: {int(good.sum())} of {int(wide.sum())} with more than {WIDE:.0%} overlap found,", end=" ")
    if good.any():
        print(f"worst {table[good, 2].max():.2f} deg {1e3 * table[good, 3].max():.2f} mm;", end=" ")
    print(f"accepted below that overlap {int((table[:, 1] > 0).sum() - good.sum())}; {table[:, 4].mean():.2f} cpu s a pair")


def refinement(name: str, scans: Sequence[Scan], truth: Sequence[FloatArray]) -> None:
    """From 4 degrees and 3 edges off: ours and small_gicp's on the same voxel means."""
    edge = common_edge([scan.cloud.points for scan in scans])
    target, source = (surface_of(scan, edge) for scan in scans[:2])
    known, centre = inverse(truth[0]) @ truth[1], source.points.mean(axis=0)
    start = off_by(known, centre, edge)
    _row(name, "ours", lambda: _ours(source, target, start), known, centre)
    if importlib.util.find_spec("small_gicp") is None:
        print("  small_gicp is not installed here")
        return
    import small_gicp

    for kind in ("PLANE_ICP", "GICP"):
        options = {"registration_type": kind, "max_correspondence_distance": 4 * edge, "num_threads": 1, "downsampling_resolution": 0.5 * edge}
        _row(
            name,
            f"small_gicp {kind}",
            lambda options=options: small_gicp.align(target.points, source.points, start, **options).T_target_source,
            known,
            centre,
        )


def _ours(source: Surface, target: Surface, start: FloatArray) -> FloatArray:
    return icp(source, target, target.tree(), start).T_target_source


Told = tuple[FloatArray | None, bool]  # the transform, and whether it is accepted


def _by_ours(target: Surface, source: Surface, edge: float, start: FloatArray) -> Told:
    link = Matcher([target, source], 0).search(0, 1)
    return (None, False) if link is None else (link.T_target_source, link.used)


def _by_open3d(target: Surface, source: Surface, edge: float, start: FloatArray) -> Told:
    """FPFH, mutual matches, RANSAC and point to plane as in its tutorial. Accepted: half of the source near the target (it has no judgement)."""
    import open3d

    reg, search = open3d.pipelines.registration, open3d.geometry.KDTreeSearchParamHybrid
    open3d.utility.random.seed(0)
    clouds = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(each.points.copy())) for each in (source, target)]
    for cloud in clouds:
        cloud.estimate_normals(search(2 * edge, 30))
    own = [reg.compute_fpfh_feature(cloud, search(5 * edge, 100)) for cloud in clouds]
    first = reg.registration_ransac_based_on_feature_matching(
        *clouds, *own, True, 1.5 * edge, reg.TransformationEstimationPointToPoint(False), 3,
        [reg.CorrespondenceCheckerBasedOnEdgeLength(0.9), reg.CorrespondenceCheckerBasedOnDistance(1.5 * edge)],
        reg.RANSACConvergenceCriteria(100_000, 0.999),
    )  # fmt: skip
    found = reg.registration_icp(*clouds, edge, first.transformation, reg.TransformationEstimationPointToPlane())
    return np.array(found.transformation), found.fitness > 0.5


def _by_kiss_matcher(target: Surface, source: Surface, edge: float, start: FloatArray) -> Told:
    """With its defaults at that edge; its answer is meant to be refined afterwards. Edges below a centimetre it refuses: then in millimetres."""
    import kiss_matcher

    unit = 1.0 if edge > 0.01 else 1e-3
    found = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(edge / unit)).estimate(source.points / unit, target.points / unit)
    return rigid(np.asarray(found.rotation), unit * np.asarray(found.translation).ravel()), True


def _by_small_gicp(target: Surface, source: Surface, edge: float, start: FloatArray) -> Told:
    import small_gicp

    options = {"max_correspondence_distance": 4 * edge, "num_threads": 1, "downsampling_resolution": 0.5 * edge}
    found = small_gicp.align(target.points, source.points, start, registration_type="GICP", **options)
    return found.T_target_source, bool(found.converged)


def _by_kiss_icp(target: Surface, source: Surface, edge: float, start: FloatArray) -> Told:
    """Its registration of one cloud to a map of the other; it is made for sequences."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.mapping import get_voxel_hash_map
    from kiss_icp.registration import get_registration

    config = KISSConfig()
    config.mapping.voxel_size, config.registration.max_num_threads = edge, 1
    world = get_voxel_hash_map(config)
    world.add_points(target.points.copy())  # its binding takes writable arrays only
    T = get_registration(config).align_points_to_map(source.points.copy(), world, start, 4 * edge, edge)
    return np.asarray(T), True


PEERS = {
    "ours": ("scan2fea", _by_ours), "Open3D FPFH + RANSAC + ICP": ("open3d", _by_open3d), "kiss-matcher": ("kiss_matcher", _by_kiss_matcher),
    "ours, refined from a start": ("scan2fea", lambda target, source, edge, start: (_ours(source, target, start), True)),
    "small_gicp GICP from a start": ("small_gicp", _by_small_gicp), "KISS-ICP from a start": ("kiss_icp", _by_kiss_icp),
}  # fmt: skip


def peers(name: str, scans: Sequence[Scan], truth: Sequence[FloatArray]) -> None:
    """Every pair with more than 30 % overlap, on the same voxel means; a start is 4 degrees and 3 edges off. Right: within 3 degrees and 4 edges."""
    edge = common_edge([scan.cloud.points for scan in scans])
    surfaces = [surface_of(scan, edge) for scan in scans]
    for how, (package, verb) in PEERS.items():
        if importlib.util.find_spec(package) is None:
            print(f"  {package} is not installed here")
            continue
        rows = []
        for b in range(len(scans)):
            for a in range(b):
                known, centre = inverse(truth[a]) @ truth[b], surfaces[b].points.mean(axis=0)
                if judge(surfaces[b], surfaces[a], surfaces[a].tree(), known).overlap <= WIDE:
                    continue
                started = time.process_time()
                T, accepted = verb(surfaces[a], surfaces[b], edge, off_by(known, centre, edge))
                cpu = time.process_time() - started
                rows.append((*(error(T, known, centre) if T is not None else (180.0, np.inf)), cpu, accepted))
        _told(f"{name} pairs, edge {edge:.3g} m, {how}", rows, edge, len(rows))


def off_by(known: FloatArray, centre: FloatArray, edge: float) -> FloatArray:
    """A start 4 degrees and 3 edges off."""
    about, R = applied(known, centre[None])[0], rotation_about([1.0, 2.0, 3.0], np.radians(4.0))
    return orthonormal(rigid(R, about - R @ about + np.array([3.0, 0, 0]) * edge) @ known)


def _told(what: str, rows: Sequence[tuple[float, float, float, bool]], edge: float, n_pairs: int) -> None:
    table = np.array(rows, float).reshape(-1, 4)
    right = (table[:, 0] < 3.0) & (table[:, 1] < 4.0 * edge)
    middle = np.median(table[right, :2], axis=0) if right.any() else np.full(2, np.nan)
    accepted = table[:, 3] > 0
    wrong = int((accepted & ~right).sum())
    print(f"  {what}: {int(right.sum())} of {n_pairs} right, {int(accepted.sum())} accepted, of these wrong {wrong},", end=" ")
    print(f"median of the right {middle[0]:.2f} deg {1e3 * middle[1]:.0f} mm, {table[:, 2].mean():.2f} cpu s a pair")


def corrected(name: str, scans: Sequence[Scan], truth: Sequence[FloatArray]) -> None:
    """`registration.correct` with the reference poses given, and with those of the last frame off by 1 degree and 3 edges."""
    edge = common_edge([scan.cloud.points for scan in scans])
    about = applied(truth[-1], scans[-1].cloud.points.mean(axis=0)[None])[0]
    R = rotation_about([1.0, 2.0, 3.0], np.radians(1.0))
    off = rigid(R, about - R @ about + np.array([3.0, 0, 0]) * edge) @ truth[-1]
    for what, given in (("reference poses", list(truth)), ("last frame 1 deg and 3 edges off", [*truth[:-1], off])):
        started = time.process_time()
        found = place(scans, given, [str(k) for k in range(len(scans))], RegistrationOptions(correct=True))
        cpu = time.process_time() - started
        T, moved = found.trajectory.T_world_frame, sum("corrected" in note for note in found.notes)
        each = [error(inverse(T[0]) @ T[k], inverse(truth[0]) @ truth[k], scans[k].cloud.points.mean(axis=0)) for k in range(1, len(scans))]
        worst, last = [max(e[i] for e in each) for i in (0, 1)], each[-1]
        print(f"  {name} correct, {what}: {moved} moved, worst {worst[0]:.2f} deg {1e3 * worst[1]:.1f} mm,", end=" ")
        print(f"last {last[0]:.2f} deg {1e3 * last[1]:.1f} mm (edge {1e3 * edge:.0f} mm), {cpu:.1f} cpu s")


def _row(name: str, how: str, verb: object, known: FloatArray, centre: FloatArray) -> None:
    verb()  # type: ignore[operator]
    started = time.process_time()
    T = verb()  # type: ignore[operator]
    cpu = time.process_time() - started
    turn, shift = error(T, known, centre)
    print(f"  {name} refinement, {how}: {turn:.3f} deg {1e3 * shift:.2f} mm, {cpu:.2f} cpu s")


def pcl() -> None:
    """No truth: what the links say."""
    at = folder()
    groups = {"pcl_pairwise": sorted((at / "pcl_pairwise").glob("*.pcd")), "pcl_room": sorted((at / "pcl_room").glob("*.pcd"))}
    for name, paths in groups.items():
        scans = [read_scan(path).scan for path in paths]
        edge = common_edge([scan.cloud.points for scan in scans])
        started = time.process_time()
        found = register([surface_of(scan, edge) for scan in scans], [None] * len(scans))
        print(f"{name}: {int(found.placed.sum())} of {len(scans)} placed, edge {edge:.3f} m, {time.process_time() - started:.1f} cpu s")
        for link in found.links:
            q = link.quality
            told = f"overlap {q.overlap:.2f} consistency {q.consistency:.2f} residual {1e3 * q.residual_m:.1f} mm"
            print(f"  {link.target}-{link.source} {told} {link.reason}")


CASES = {"bunny": bunny, "kitti": kitti, "3dmatch": match3d, "gicp": gicp_pair, "car": car, "demo": demo}


def main(names: Sequence[str]) -> None:
    for name in names or [*CASES, "pcl"]:
        if name == "pcl":
            pcl()
            continue
        scans, truth = CASES[name]()
        all_frames(name, scans, truth)
        pairs(name, scans, truth)
        refinement(name, scans, truth)
        peers(name, scans, truth)
        corrected(name, scans, truth)


if __name__ == "__main__":
    main(sys.argv[1:])
