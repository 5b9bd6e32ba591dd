"""A set of photographs becomes one frame per photograph: its points in its own camera's axes, and its pose.

structure (poses, lens) -> pairs rectified and matched -> depths of each photograph -> what other photographs confirm -> each place kept once, by the
photograph that knows it best -> scale, where something tells it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.acquisition.acquired import Acquired, Frame, nothing, seen_from
from scan2fea.acquisition.agreement import Agreement, Places, confirmed
from scan2fea.acquisition.depths import Depths, Picture, Told, pairs_of, together, told_by
from scan2fea.acquisition.images import Header, read_colour, read_grey, read_header, sharpness
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.scale import Scale, length_of, scale_of
from scan2fea.acquisition.structure import Structure, View, structure
from scan2fea.errors import InputError, require
from scan2fea.types import ByteArray, FloatArray, Scan

BLURRED = 0.4  # of the median sharpness of the set
_SPARSE = 10.0  # error along over across the line of sight of a point that was told under about six degrees
_NORMAL_PX = 4  # half the base over which slopes are taken
_ACROSS_PX = 1.0 / np.sqrt(12.0)


def from_photographs(paths: Sequence[Path], options: AcquisitionOptions) -> Acquired:
    """Poses and dense points of photographs of one scene. Lengths are metres where options.scale or known_length tells them, else those in which
    the first two cameras lie 1 apart, and `unit_source` is "unknown".

    Raises InputError where fewer than two can be used, UsageError for a scale that cannot be read.
    """
    wanted = length_of(options)
    headers, reason = _headers(paths)
    usable = [path for path in paths if path in headers]
    others = f" ({len(reason)} cannot be used: {next(iter(reason.values()))})" if reason else ""
    says = f"{paths[0]}: one photograph alone has no depth: take several of the same things, from places a step apart{others}"
    require(len(usable) > 1, InputError, says)
    solved = structure(usable, headers, options)
    pictures = [_picture(view, options.max_px) for view in solved.views]
    depths, rows, n_pairs = _matched(solved, pictures, options)
    kept = confirmed(solved.views, pictures, depths)
    scans = [
        _scan(view, picture, depth, places, kept.factor, solved)
        for view, picture, depth, places in zip(solved.views, pictures, depths, kept.kept, strict=True)
    ]
    scale = scale_of(wanted, solved, depths, pictures) if wanted is not None else None
    frames = _frames(paths, solved, scans, {**reason, **solved.reason}, scale)
    how = _how(solved, depths, kept, rows, n_pairs, scale, headers)
    said = ("--calibration is of stereo pairs: the lens of photographs is found from them",) if options.calibration else ()
    return Acquired(
        frames=frames, unit_source="option" if scale else "unknown", how=how, notes=(*said, *_notes(usable, headers, solved, kept, scale))
    )  # fmt: skip


def _headers(paths: Sequence[Path]) -> tuple[dict[Path, Header], dict[str, str]]:
    headers, reason = {}, {}
    for path in paths:
        try:
            headers[path] = read_header(path)
        except InputError as error:
            reason[str(path)] = str(error)
    return headers, reason


def _picture(view: View, most_px: int) -> Picture:
    """The photograph without distortion, its longer side at most `most_px`."""
    import cv2

    colour: ByteArray = read_colour(Path(view.path))
    shrink = min(1.0, most_px / max(view.size))
    size = (round(view.size[0] * shrink), round(view.size[1] * shrink))
    sx, sy = size[0] / view.size[0], size[1] / view.size[1]
    K = view.camera.K.copy()
    K[0], K[1] = K[0] * sx, K[1] * sy
    K[0, 2], K[1, 2] = (view.camera.K[0, 2] + 0.5) * sx - 0.5, (view.camera.K[1, 2] + 0.5) * sy - 0.5
    if shrink < 1.0:
        colour = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), np.uint8)
    flat = np.asarray(cv2.undistort(colour, K, view.camera.distortion, None, K), np.uint8)
    return Picture(K=K, colour=flat, grey=np.asarray(cv2.cvtColor(flat, cv2.COLOR_RGB2GRAY), np.uint8))


def _matched(solved: Structure, pictures: Sequence[Picture], options: AcquisitionOptions) -> tuple[list[Depths], FloatArray, int]:
    """Depths of each view, the errors of rows (k,) of features, and how many pairs were matched."""
    pairs = pairs_of(solved.views, solved.points, options.neighbours)

    def one(pair: tuple[int, int]) -> tuple[Told, Told, FloatArray] | None:
        i, j = pair
        return told_by(solved.views[i], solved.views[j], (pictures[i], pictures[j]), solved.points)

    with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:  # OpenCV lets other threads run
        made = list(pool.map(one, pairs))
    told: list[list[Told]] = [[] for _ in solved.views]
    rows = [np.zeros(0)]
    for (i, j), found in zip(pairs, made, strict=True):
        if found is not None:
            told[i].append(found[0])
            told[j].append(found[1])
            rows.append(found[2])
    empty = [np.full(picture.grey.shape, np.nan) for picture in pictures]
    depths = [
        together(own) if own else Depths(w=blank, sigma=blank, n=np.zeros(blank.shape), scatter=float("nan"))
        for own, blank in zip(told, empty, strict=True)
    ]
    return depths, np.concatenate(rows), sum(found is not None for found in made)


def _scan(view: View, picture: Picture, depth: Depths, places: Places, factor: float, solved: Structure) -> Scan:
    """Points of a view in its camera's axes; where matching kept none, the sparse points that it shows, with the error of two lines of sight."""
    if len(places.w) == 0:
        local = (solved.points[view.point] - view.T_world_camera[:3, 3]) @ view.T_world_camera[:3, :3]
        across = np.abs(local[:, 2]) / view.camera.K[0, 0] * max(solved.error_px, _ACROSS_PX)
        return seen_from(np.zeros(3), local, _SPARSE * across, across) if len(local) else nothing()
    along = factor * places.sigma / places.w**2 * np.linalg.norm(places.rays, axis=1)
    across = _ACROSS_PX / places.w / picture.K[0, 0]
    columns = {"colour": picture.colour[places.y, places.x], "normals": _normals(picture, depth.w, places)}
    return seen_from(np.zeros(3), places.rays / places.w[:, None], along, across, **columns)


def _normals(picture: Picture, w: FloatArray, places: Places) -> FloatArray:
    """(n, 3) unit, toward the camera. A plane a.X = 1 has w = a.ray: inverse depth is linear in the picture, its slopes and value give a."""
    import cv2

    size = (2 * _NORMAL_PX + 1, 2 * _NORMAL_PX + 1)
    known = np.isfinite(w)
    weight = known.astype(np.float64)
    value = np.where(known, w, 0.0)
    column, row = np.meshgrid(np.arange(w.shape[1], dtype=np.float64), np.arange(w.shape[0], dtype=np.float64))

    def total(v: FloatArray) -> FloatArray:
        return np.asarray(cv2.boxFilter(v, cv2.CV_64F, size, normalize=False, borderType=cv2.BORDER_CONSTANT)[places.y, places.x])

    n = np.maximum(total(weight), 1.0)
    mx, my, mw = total(weight * column) / n, total(weight * row) / n, total(value) / n
    sxx, syy = total(weight * column**2) / n - mx**2, total(weight * row**2) / n - my**2
    sxy = total(weight * column * row) / n - mx * my
    sxw, syw = total(value * column) / n - mx * mw, total(value * row) / n - my * mw
    det = np.maximum(sxx * syy - sxy**2, 1e-9)
    du, dv = (sxw * syy - syw * sxy) / det, (syw * sxx - sxw * sxy) / det
    K = picture.K
    a = np.stack([du * K[0, 0], dv * K[1, 1], mw - du * (mx - K[0, 2]) - dv * (my - K[1, 2])], axis=1)
    a = -a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-300)
    away = np.einsum("nc,nc->n", a, places.rays) > 0
    return np.asarray(np.where(away[:, None], -a, a))


def _frames(paths: Sequence[Path], solved: Structure, scans: Sequence[Scan], reason: Mapping[str, str], scale: Scale | None) -> tuple[Frame, ...]:
    made = {view.path: (view, scan) for view, scan in zip(solved.views, scans, strict=True)}
    factor = scale.m_per_unit if scale else 1.0
    frames = []
    for path in paths:
        if str(path) not in made:
            frames.append(Frame(name=str(path), scan=nothing(), reason=reason.get(str(path), f"{path.name}: was not placed")))
            continue
        view, scan = made[str(path)]
        T = view.T_world_camera.copy()
        T[:3, 3] *= factor
        frames.append(Frame(name=str(path), scan=_scaled(scan, factor), T_world_frame=T))
    return tuple(frames)


def _scaled(scan: Scan, factor: float) -> Scan:
    cloud, rays = scan.cloud, scan.rays
    if factor == 1.0 or rays is None or cloud.sigma_along_m is None or cloud.sigma_across_m is None:
        return scan
    cloud = cloud.replaced(
        points=cloud.points * factor, sigma_along_m=cloud.sigma_along_m * factor, sigma_across_m=cloud.sigma_across_m * factor
    )  # fmt: skip
    return Scan(cloud=cloud, rays=replace(rays, origin=rays.origin * factor, range_m=rays.range_m * factor))


def _how(
    solved: Structure, depths: Sequence[Depths], kept: Agreement, rows: FloatArray, n_pairs: int, scale: Scale | None, headers: Mapping[Path, Header]
) -> dict[str, Any]:
    cameras = {view.path: view.camera for view in solved.views}
    first = next(iter(cameras.values()))
    return {
        "method": "photographs", **solved.how, "n_pairs": n_pairs, "epipolar_px_median": float(np.median(rows)) if len(rows) else None,
        "epipolar_px_p95": float(np.percentile(rows, 95)) if len(rows) else None, "n_dense": sum(len(k.w) for k in kept.kept),
        "agree_2sigma": kept.within_2, "widened": kept.factor, "scatter": [d.scatter for d in depths],
        "focal_px": float(first.K[0, 0]), "centre_px": first.K[:2, 2].tolist(), "radial": float(first.distortion[0]),
        "exif_focal_px": next((h.focal_px for h in headers.values() if np.isfinite(h.focal_px)), None),
        "scale_m": scale.m_per_unit if scale else None, "scale_relative_std": scale.relative_std if scale else None,
        "scale_from": scale.told if scale else None,
    }  # fmt: skip


def _notes(usable: Sequence[Path], headers: Mapping[Path, Header], solved: Structure, kept: Agreement, scale: Scale | None) -> tuple[str, ...]:
    notes = []
    cameras = {(h.width, h.height, h.camera) for h in headers.values()}
    if len(cameras) > 1:
        told = "; ".join(sorted(f"{w} x {h} px {name or 'no EXIF'}" for w, h, name in cameras))
        notes.append(f"photographs of {len(cameras)} cameras ({told}): each has a lens of its own, which is known less well than one of all")
    if not any(np.isfinite(h.focal_px) for h in headers.values()):
        notes.append("no photograph states its focal length (EXIF): it was found from the pictures alone")
    sharp = {path: sharpness(read_grey(path)) for path in usable}
    middle = float(np.median(list(sharp.values())))
    blurred = [path.name for path, value in sharp.items() if value < BLURRED * middle]
    if blurred:
        notes.append(f"blurred beside the others: {', '.join(blurred)}")
    if len(solved.views) < len(usable):
        notes.append(f"{len(solved.views)} of {len(usable)} photographs were placed")
    bare = [Path(view.path).name for view, places in zip(solved.views, kept.kept, strict=True) if len(places.w) == 0]
    if bare:
        notes.append(f"no dense depths from {', '.join(bare)} (moved along the view, or too far apart): its points are the few that fixed the poses")
    if kept.factor > 1.5:
        notes.append(f"depths of neighbouring photographs differ by {kept.factor:.1f} times what matching says: standard deviations were widened")
    if scale is not None:
        notes.append(f"scale from {scale.told}: {scale.relative_std:.2%} of every length (standard deviation)")
    else:
        notes.append('the scale is not known: lengths are in distances of the first two cameras; --scale "0.25 m between targets A B" tells it')
    return tuple(notes)
