"""What noise along known rays does to a section that was fitted as if noise were alike in all directions.

A ray that stands off a face's normal moves a point by sigma cos(phi) off the face and by sigma sin(phi) along it, so that faces scanned head on end
more sharply than they are rough, and those scanned aslant the other way round. The expected scores under that noise are not zero at the section that
was scanned; where they are zero is what a fit of very many points comes to. The difference is the bias, found by scoring on points that stand for
the noise along each ray (Gauss-Hermite), their feet spread evenly along the face that the ray hit.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from scan2fea.estimation.outline import outline_distance
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.section_likelihood import face_lengths, information, is_section, lines_of, log_density
from scan2fea.kernel.sections import PARAMETERS, ROUND, section
from scan2fea.types import FloatArray, IntArray, Member, PointCloud, Scan

_POINTS = 4_000
_NODES = 7
_ROUNDS = 4
_NEAR = 4.0  # standard deviations from a face
_FLAT = 0.05  # least cosine between a ray and the normal of the face it hit
_DOUBT = 1 / 3  # of the bias
_LEAST = 30  # points
_TINY = 1e-12


def freed_of_ray_noise(scan: Scan, member: Member, face_weight: FloatArray | None, seed: int) -> Member:
    """The member without the bias of its told dimensions, a third of which stays as doubt; as it was where the noise is none along rays.

    face_weight : (f,) points per metre of each face, relative; None: all alike.
    """
    if member.family in ROUND or member.change is not None or scan.rays is None or not (scan.cloud.ray >= 0).any():
        return member
    values = np.array([member.values()[name] for name in PARAMETERS[member.family]])
    weight = np.ones(len(face_lengths(member.family, values))) if face_weight is None else face_weight
    u, way = _in_section(scan.cloud, scan.rays.direction, member, seed)
    face, off, facing = _faces_hit(member, values, u, way)
    own = (np.abs(off) < _NEAR * member.sigma_m) & (facing > _FLAT)
    if int(own.sum()) < _LEAST or not acts_along(off[own], facing[own]):
        return member
    bias = bias_of(member.family, values, member.sigma_m, member.noise, weight, way[own], face[own])
    if bias is None:
        return member
    covariance, parameters = np.array(member.covariance), list(member.parameters)
    for k, p in enumerate(parameters[: len(values)]):
        if p.source == "fitted" and p.observable and p.std_m is not None:
            covariance[k, k] = p.std_m**2 + (_DOUBT * bias[k]) ** 2
            parameters[k] = dataclasses.replace(p, value_m=p.value_m - float(bias[k]), std_m=math.sqrt(covariance[k, k]))
    return dataclasses.replace(member, parameters=tuple(parameters), covariance=covariance)


def _in_section(cloud: PointCloud, direction: FloatArray, member: Member, seed: int) -> tuple[FloatArray, FloatArray]:
    """(n, 2) some of the points whose ray is known, and the directions (n, 2) of their rays, across the member."""
    known = cloud.ray >= 0
    if cloud.is_inferred is not None:
        known &= ~cloud.is_inferred
    rows = np.flatnonzero(known)
    rows = rows[sampled_rows(len(rows), _POINTS, seed)]
    way = direction[cloud.ray[rows]] @ member.T_world_member[:3, :2]
    return sweep_of_member(member).coordinates(cloud.points[rows])[:, :2], way


def _faces_hit(member: Member, values: FloatArray, u: FloatArray, way: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """The nearest face of each point, how far off it the point lies, and the cosine between its normal and the way back to the sensor."""
    shape = section(member.family, dict(zip(PARAMETERS[member.family], values.tolist(), strict=True)))
    distance, face, _ = outline_distance(shape, u)
    start = np.concatenate(shape.loops)
    along = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    normal = np.stack([along[:, 1], -along[:, 0]], 1) / np.linalg.norm(along, axis=1)[:, None]
    middle = start + along / 2 + 1e-6 * np.ptp(start, axis=0).max() * normal
    normal *= np.where(outline_distance(shape, middle)[0] > 0, 1.0, -1.0)[:, None]  # outward
    return face, distance, -np.einsum("ij,ij->i", way, normal[face])


def acts_along(off: FloatArray, facing: FloatArray) -> bool:
    """Whether distances (n,) off a face scatter rather in proportion to the cosine (n,) between ray and normal than alike.

    Their logarithms then grow as that of the cosine, with a slope nearer to one than to none: a few points of another face weigh little.
    """
    away, cosine = np.log(np.maximum(np.abs(off), _TINY)), np.log(facing)
    cosine = cosine - cosine.mean()
    return float(cosine @ away) > 0.5 * float(cosine @ cosine)


def bias_of(
    family: str, values: FloatArray, sigma_m: float, noise: str, face_weight: FloatArray, way: FloatArray, face: IntArray
) -> FloatArray | None:
    """(p,) what a fit of very many points differs by from the section that was scanned; None where it comes to none.

    way : (n, 2) directions of rays across the member, of unit length in space.   face : (n,) the face that each hit.
    """
    lengths = face_lengths(family, values)
    axis, line, low, high = lines_of(family)
    share = face_weight * lengths / float(face_weight @ lengths)
    nodes, mass = np.polynomial.hermite_e.hermegauss(_NODES)
    across = np.take_along_axis(way, axis[face][:, None], axis=1)[:, 0]
    hit = [np.flatnonzero(face == k) for k in range(len(lengths))]
    told = [k for k in range(len(lengths)) if len(hit[k]) > 0 and share[k] > 0]
    scatter = sum(share[k] * float(np.mean(across[hit[k]] ** 2)) for k in told) / sum(share[k] for k in told)
    points, weight = [], []
    for k in told:
        rows = np.random.default_rng(k).permutation(hit[k])
        foot = np.empty((len(rows), 2))
        foot[:, axis[k]] = line[k] @ values
        foot[:, 1 - axis[k]] = low[k] @ values + (np.arange(len(rows)) + 0.5) / len(rows) * ((high[k] - low[k]) @ values)
        moved = foot[:, None] + sigma_m / math.sqrt(scatter) * nodes[None, :, None] * way[rows][:, None]
        points.append(moved.reshape(-1, 2))
        weight.append(np.tile(share[k] * mass / mass.sum() / len(rows), len(rows)))
    at, weights, n = np.concatenate(points), np.concatenate(weight), len(values)
    found = np.r_[values, 0.0, 0.0, 0.0, math.log(sigma_m)]
    inverse = np.linalg.pinv(information(family, values, sigma_m, noise, face_weight).matrix)
    for _ in range(_ROUNDS):
        if not is_section(family, found[:n]):
            return None
        c, s = math.cos(found[n]), math.sin(found[n])
        u = (at - found[n + 1 : n + 3]) @ np.array([[c, -s], [s, c]])
        d = log_density(u, family, found[:n], math.exp(found[n + 3]), noise, face_weight)
        by_roll = d.d_point[:, 0] * u[:, 1] - d.d_point[:, 1] * u[:, 0]
        by_place = -d.d_point @ np.array([[c, s], [-s, c]])
        found += inverse @ (weights @ np.column_stack([d.d_values, by_roll, by_place, d.d_log_sigma]))
    return np.asarray(found[:n] - values)
