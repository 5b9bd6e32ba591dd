"""Scans of prismatic members by brute force in numpy, with every ray known: independent of the library's own ray casting."""

import dataclasses

import numpy as np

from scan2fea.kernel.sections import PARAMETERS, section
from scan2fea.kernel.transforms import applied, inverse, rigid, rotated, rotation_about
from scan2fea.types import Member, Parameter, PointCloud, Rays, Scan

THIN_L = {"a": 0.127, "b": 0.127, "t": 0.00635}  # thesis 3.3.1, 3.048 m long


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sensor:
    """sigma_m along the ray; noise "normal" or "uniform" (within +-sigma_m); footprint_rad full opening; the range that `n_beams` rays of it give:

    that of one of them ("photon"), or the mean of those that hit, where more than half of them do ("half") or any ("any").
    """

    sigma_m: float = 0.02
    noise: str = "normal"
    footprint_rad: float = 0.0
    n_beams: int = 9
    returns: str = "photon"
    outlier_share: float = 0.0
    dropped_share: float = 0.0


def pose(seed, roll=None, height=None):
    """A level beam whose axis points any way, rolled at random, at a height of 0.5 to 1.6 m."""
    rng = np.random.default_rng([seed, 77])
    turn = rng.uniform(0, 2 * np.pi) if roll is None else roll
    flat = rotation_about((0, 0, 1), rng.uniform(0, 2 * np.pi)) @ rotation_about((0, 1, 0), np.pi / 2)
    return rigid(
        flat @ rotation_about((0, 0, 1), turn), (rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(0.5, 1.6) if height is None else height)
    )


def member(family, values, length, T_world_member, bow=((), ())):
    parameters = tuple(
        Parameter(name=n, value_m=v, std_m=None, observable=True, source="fixed")
        for n, v in [*((n, values[n]) for n in PARAMETERS[family]), ("length", length)]
    )
    return Member(
        family=family, parameters=parameters, T_world_member=T_world_member, bow=np.array(bow, float).reshape(2, -1), twist=np.zeros(0),
        end_normals=np.array([[0, 0, -1.0], [0, 0, 1.0]]), covariance=np.zeros((len(parameters),) * 2), sigma_m=0.01, noise="normal",
        outlier_share=0.0, seen={}, families={family: 1.0},
    )  # fmt: skip


def cast(solid, origin, direction):
    """(n,) range at which rays meet the member's solid (sides and square ends), inf where they pass; every edge against every ray."""
    to_member = inverse(solid.T_world_member)
    o, d = applied(to_member, origin), rotated(to_member, direction)
    length = solid.values()["length"]
    shift = np.zeros((len(o), 2))
    hit = np.full(len(o), np.inf)
    for _ in range(3 if solid.bow.size else 1):
        hit = _cast_straight(solid, np.column_stack([o[:, :2] - shift, o[:, 2]]), d, length)
        if solid.bow.size:
            at = np.where(np.isfinite(hit), hit, -np.einsum("nc,nc->n", o[:, :2], d[:, :2]) / np.einsum("nc,nc->n", d[:, :2], d[:, :2]))
            t = np.clip(2 * (o[:, 2] + at * d[:, 2]) / length - 1, -1, 1)
            shift = np.stack([np.polynomial.legendre.legval(t, np.r_[0, 0, row]) for row in solid.bow], 1)
    return hit


def _cast_straight(solid, o, d, length):
    shape = section(solid.family, solid.values())
    best = np.full(len(o), np.inf)
    with np.errstate(all="ignore"):
        for loop in shape.loops:
            for p, edge in zip(loop, np.roll(loop, -1, 0) - loop, strict=True):
                cross = d[:, 0] * edge[1] - d[:, 1] * edge[0]
                w = p - o[:, :2]
                s = (w[:, 0] * edge[1] - w[:, 1] * edge[0]) / cross
                k = (w[:, 0] * d[:, 1] - w[:, 1] * d[:, 0]) / cross
                z = o[:, 2] + s * d[:, 2]
                good = (s > 0) & (k >= 0) & (k <= 1) & (z >= 0) & (z <= length)
                best = np.where(good & (s < best), s, best)
        for height in (0.0, length):
            s = (height - o[:, 2]) / d[:, 2]
            at = o[:, :2] + s[:, None] * d[:, :2]
            inside = np.zeros(len(o), bool)
            for loop in shape.loops:
                nxt = np.roll(loop, -1, 0)
                for p, n in zip(loop, nxt, strict=True):
                    inside ^= ((p[1] > at[:, 1]) != (n[1] > at[:, 1])) & (at[:, 0] < (n[0] - p[0]) * (at[:, 1] - p[1]) / (n[1] - p[1]) + p[0])
            best = np.where(inside & (s > 0) & (s < best), s, best)
    return best


def shoot(solid, origin, direction, sensor, rng):
    """The scan by these rays: hits and misses."""
    n = len(origin)
    if sensor.footprint_rad > 0:
        across = _perpendicular(direction)
        wobble = rng.standard_normal((sensor.n_beams, 2, n)) * sensor.footprint_rad / 4
        beams = []
        for one in wobble:
            bent = direction + one[0][:, None] * across[0] + one[1][:, None] * across[1]
            beams.append(cast(solid, origin, bent / np.linalg.norm(bent, axis=1)[:, None]))
        ranges = np.array(beams)
        if sensor.returns == "photon":
            r = ranges[0]
        else:
            hit = np.isfinite(ranges)
            mean = np.where(hit, ranges, 0).sum(0) / np.maximum(hit.sum(0), 1)
            least = sensor.n_beams / 2 if sensor.returns == "half" else 0
            r = np.where(hit.sum(0) > least, mean, np.inf)
    else:
        r = cast(solid, origin, direction)
    hit = np.isfinite(r)
    noise = rng.standard_normal(n) if sensor.noise == "normal" else rng.uniform(-1, 1, n)
    r = np.where(hit, r + sensor.sigma_m * noise, np.nan)
    if sensor.dropped_share:
        r[rng.random(n) < sensor.dropped_share] = np.nan
    rows = np.flatnonzero(np.isfinite(r))
    if sensor.outlier_share:
        wrong = rows[rng.random(len(rows)) < sensor.outlier_share]
        r[wrong] += rng.uniform(-0.3, 0.3, len(wrong))
    cloud = PointCloud.of(origin[rows] + r[rows, None] * direction[rows], ray=rows)
    foot = np.full(n, sensor.footprint_rad) if sensor.footprint_rad > 0 else None
    return Scan(cloud=cloud, rays=Rays(origin=origin, direction=direction, range_m=r, footprint_rad=foot))


def _perpendicular(direction):
    helper = np.where(np.abs(direction[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    u = np.cross(direction, helper)
    u /= np.linalg.norm(u, axis=1)[:, None]
    return u, np.cross(direction, u)


def all_round(solid, n_hits, sensor, seed, n_stations=6, distance=(2.0, 4.0)):
    """Stations on every side; rays at random points of a box 1.5 times the section, until `n_hits` come back."""
    rng = np.random.default_rng([seed, 5])
    length = solid.values()["length"]
    size = max(v for k, v in solid.values().items() if k != "length")
    middle = _middle(solid)
    angle = 2 * np.pi * (np.arange(n_stations) + rng.random(n_stations)) / n_stations
    radius = rng.uniform(*distance, n_stations)
    stations = np.column_stack(
        [middle + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), rng.uniform(0.1, 0.9, n_stations) * length]
    )
    m = 3 * n_hits
    origin = stations[rng.integers(n_stations, size=m)]
    aim = np.column_stack([middle + rng.uniform(-0.75, 0.75, (m, 2)) * size, rng.uniform(-0.02, 1.02, m) * length])
    direction = aim - origin
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    hits = np.cumsum(np.isfinite(cast(dataclasses.replace(solid, T_world_member=np.eye(4)), origin, direction)))
    last = int(np.searchsorted(hits, n_hits)) + 1
    return shoot(solid, applied(solid.T_world_member, origin[:last]), rotated(solid.T_world_member, direction[:last]), sensor, rng)


def _middle(solid):
    corners = np.concatenate(section(solid.family, solid.values()).loops)
    return (corners.min(0) + corners.max(0)) / 2


def ring_scan(solid, side, sensor, seed, n_frames=20, share=1.0, step_deg=0.4):
    """HDL-32E on a table 1 m above the floor that moves on one side of a level member: `side` +1 where the section's +x +y quadrant looks."""
    rng = np.random.default_rng([seed, 6])
    elevation = np.deg2rad(np.linspace(-30.67, 10.67, 32))
    length, T = solid.values()["length"], solid.T_world_member
    axis = T[:3, 2]
    centre = T[:3, 3] + axis * length / 2
    out = side * (T[:3, 0] + T[:3, 1])
    out = out - out[2] * np.array([0, 0, 1.0])
    out /= np.linalg.norm(out)
    frames = np.arange(n_frames)[:: round(1 / share)]
    origins, directions = [], []
    for f in frames:
        away = 2.0 + 3.0 * f / max(n_frames - 1, 1)
        along = length * 0.7 * (rng.random() - 0.5)
        position = centre + away * out + along * axis
        position[2] = 1.0
        azimuth = np.arange(0, 2 * np.pi, np.deg2rad(step_deg)) + rng.random() * np.deg2rad(step_deg)
        near = np.cos(azimuth - np.arctan2(-out[1], -out[0])) > 0.5
        a, e = np.meshgrid(azimuth[near], elevation, indexing="ij")
        d = np.column_stack([(np.cos(e) * np.cos(a)).ravel(), (np.cos(e) * np.sin(a)).ravel(), np.sin(e).ravel()])
        w = centre - position
        keep = np.linalg.norm(np.cross(np.cross(w, axis), d), axis=1) >= 0
        origins.append(np.broadcast_to(position, d[keep].shape))
        directions.append(d[keep])
    return shoot(solid, np.concatenate(origins), np.concatenate(directions), sensor, rng)
