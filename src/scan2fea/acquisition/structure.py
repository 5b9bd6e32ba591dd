"""Where photographs were taken from, and what lens they have: structure from motion by COLMAP (Schoenberger, Frahm 2016; wheel `pycolmap`).

SIFT features, all pairs matched and checked by epipolar geometry, incremental mapping, bundle adjustment. One thread and fixed seeds: the same
photographs give the same poses. Photographs of one size, maker, model and focal length share one camera: focal length and one radial term, and, with
LEAST_FOR_CENTRE photographs or more, the principal point in a last bundle adjustment.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.acquisition.cameras import Camera
from scan2fea.acquisition.images import Header
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.errors import InputError, require
from scan2fea.kernel.colmap import colmap
from scan2fea.types import FloatArray, IntArray, Value

LEAST_FOR_CENTRE = 8
LEAST_MATCHES = 15  # of a pair that is believed (COLMAP's own limit)
_LARGEST_PX = 3200  # longer side of a photograph that features are looked for in
_FINE_PX = 2000  # longer side up to which the picture is doubled first: features of its finest detail
_MODEL = "SIMPLE_RADIAL"


@dataclass(frozen=True, eq=False, kw_only=True)
class View(Value):
    """One placed photograph. T_world_camera : x right, y down, z ahead.   point : (k,) rows of the points that it shows.   pixel : (k, 2) where."""

    path: str
    camera: Camera
    size: tuple[int, int]
    T_world_camera: FloatArray
    point: IntArray
    pixel: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure(Value):
    """Poses and points in a frame and a scale of their own. reason : of each photograph that was not placed.   error_px : mean reprojection error."""

    views: tuple[View, ...]
    points: FloatArray
    reason: Mapping[str, str]
    error_px: float
    how: Mapping[str, Any]


def structure(paths: Sequence[Path], headers: Mapping[Path, Header], options: AcquisitionOptions) -> Structure:
    """Poses of the photographs that belong together. Raises InputError where no two do."""
    root = Path(os.path.commonpath([str(path.resolve().parent) for path in paths]))
    name = {path: str(path.resolve().relative_to(root)) for path in paths}
    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "features.db"
        groups = by_camera(paths, headers)
        for group in groups:
            longest = max(headers[group[0]].width, headers[group[0]].height)
            _features(database, root, [name[path] for path in group], longest, _masks(root, name))
        matches = _matches(database, {v: k for k, v in name.items()}, options.seed)
        made = _mapped(database, root, Path(folder), options.seed)
        says = f"{paths[0].parent}: no two of the {len(paths)} photographs show the same things from different places: {_closest(matches)}"
        require(made, InputError, says)
        best = max(made, key=lambda m: (m.num_reg_images(), m.num_points3D()))
        if best.num_reg_images() >= LEAST_FOR_CENTRE:
            _with_centre(best)
        views, points = _views(best, {v: k for k, v in name.items()}, paths)
        others = {image.name for model in made if model is not best for image in model.images.values() if image.has_pose}
    placed = {view.path for view in views}
    reason = {str(p): _why(p, name[p] in others, matches.get(p, 0)) for p in paths if str(p) not in placed}
    how = {
        "n_photographs": len(paths), "n_placed": len(views), "n_cameras": len(groups), "n_points": len(points),
        "reprojection_px": float(best.compute_mean_reprojection_error()),
    }  # fmt: skip
    return Structure(views=views, points=points, reason=reason, error_px=how["reprojection_px"], how=how)


def by_camera(paths: Sequence[Path], headers: Mapping[Path, Header]) -> list[list[Path]]:
    """Photographs of one size, maker, model and focal length together."""
    groups: dict[tuple[Any, ...], list[Path]] = {}
    for path in paths:
        header = headers[path]
        key = (header.width, header.height, header.camera, round(header.focal_px, 1) if np.isfinite(header.focal_px) else None)
        groups.setdefault(key, []).append(path)
    return list(groups.values())


def _masks(root: Path, name: Mapping[Path, str]) -> Path | None:
    """A folder `masks` in or beside that of the photographs, with NAME.png for each: black is not looked at."""
    for place in (root / "masks", root.parent / "masks"):
        if place.is_dir() and any((place / f"{n}.png").is_file() for n in name.values()):
            return place
    return None


def _features(database: Path, root: Path, names: Sequence[str], longest: int, masks: Path | None) -> None:
    pycolmap = colmap()
    how = pycolmap.FeatureExtractionOptions()
    how.num_threads, how.use_gpu, how.max_image_size = 1, False, _LARGEST_PX
    how.sift.first_octave = -1 if longest <= _FINE_PX else 0
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = _MODEL
    if masks is not None:
        reader.mask_path = str(masks)
    pycolmap.extract_features(
        database, root, list(names), camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader, extraction_options=how, device=pycolmap.Device.cpu
    )


def _matches(database: Path, path_of: Mapping[str, Path], seed: int) -> dict[Path, int]:
    """Match all pairs; the number of matches of each photograph with the one that shares most."""
    pycolmap = colmap()
    how = pycolmap.FeatureMatchingOptions()
    how.num_threads, how.use_gpu = 1, False
    check = pycolmap.TwoViewGeometryOptions()
    check.ransac.random_seed = seed
    pycolmap.match_exhaustive(database, matching_options=how, verification_options=check, device=pycolmap.Device.cpu)
    best: dict[Path, int] = dict.fromkeys(path_of.values(), 0)
    with pycolmap.Database.open(database) as held:
        names = {image.image_id: image.name for image in held.read_all_images()}
        ids = sorted(names)
        for y, b in enumerate(ids):
            for a in ids[:y]:
                if held.exists_two_view_geometry(a, b):
                    n = int(held.read_two_view_geometry(a, b).inlier_matches.shape[0])
                    for k in (a, b):
                        best[path_of[names[k]]] = max(best[path_of[names[k]]], n)
    return best


def _mapped(database: Path, root: Path, folder: Path, seed: int) -> list[Any]:
    pycolmap = colmap()
    how = pycolmap.IncrementalPipelineOptions()
    how.num_threads, how.random_seed, how.min_model_size, how.extract_colors = 1, seed, 2, False
    return list(pycolmap.incremental_mapping(database, root, folder, how).values())


def _with_centre(model: Any) -> None:
    pycolmap = colmap()
    how = pycolmap.BundleAdjustmentOptions()
    how.refine_principal_point, how.print_summary = True, False
    pycolmap.bundle_adjustment(model, how)


def _views(model: Any, path_of: Mapping[str, Path], paths: Sequence[Path]) -> tuple[tuple[View, ...], FloatArray]:
    """The placed photographs in input order, and the points, with z up: the mean of the cameras' upward axes; the first two cameras lie 1 apart."""
    row = {key: k for k, key in enumerate(sorted(model.points3D))}
    points = np.array([model.points3D[key].xyz for key in row]).reshape(-1, 3)
    images = {path_of[image.name]: image for image in model.images.values() if image.has_pose}
    order = [path for path in paths if path in images]
    T = []
    for path in order:
        pose = np.eye(4)
        pose[:3] = images[path].cam_from_world().inverse().matrix()
        T.append(pose)
    gauge, scale = _gauge(T)
    views = []
    for path, own in zip(order, T, strict=True):
        image = images[path]
        seen = [p for p in image.points2D if p.has_point3D()]
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = gauge @ own[:3, :3], scale * gauge @ (own[:3, 3] - T[0][:3, 3])
        camera = model.cameras[image.camera_id]
        f, cx, cy, k = (float(x) for x in camera.params)
        # COLMAP counts pixels from the corner of the first, OpenCV from its middle
        lens = Camera(K=np.array([[f, 0.0, cx - 0.5], [0.0, f, cy - 0.5], [0.0, 0.0, 1.0]]), distortion=np.array([k, 0.0, 0.0, 0.0]))
        views.append(
            View(
                path=str(path), camera=lens, size=(int(camera.width), int(camera.height)), T_world_camera=pose,
                point=np.array([row[p.point3D_id] for p in seen], np.int64), pixel=np.array([p.xy for p in seen]).reshape(-1, 2) - 0.5,
            )
        )  # fmt: skip
    return tuple(views), np.asarray(scale * (points - T[0][:3, 3]) @ gauge.T)


def _gauge(T: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """Rotation to a frame with z up and x along the first camera's right, and the factor that sets the first two cameras 1 apart."""
    up = -np.mean([pose[:3, 1] for pose in T], axis=0)
    z = up / np.linalg.norm(up) if np.linalg.norm(up) > 0.1 else -T[0][:3, 1]
    x = T[0][:3, 0] - (T[0][:3, 0] @ z) * z
    x = x / np.linalg.norm(x)
    apart = float(np.linalg.norm(T[1][:3, 3] - T[0][:3, 3])) if len(T) > 1 else 0.0
    return np.stack([x, np.cross(z, x), z]), 1.0 / apart if apart > 0 else 1.0


def _closest(matches: Mapping[Path, int]) -> str:
    most = max(matches.values(), default=0)
    return f"at most {most} places are common to two of them, or they were taken from one place; move between photographs, and let them overlap"


def _why(path: Path, in_other: bool, matches: int) -> str:
    if in_other:
        return f"{path.name}: belongs to other photographs that share too little with the rest"
    if matches < LEAST_MATCHES:
        return f"{path.name}: shares {matches} places with any other photograph, {LEAST_MATCHES} are needed: it shows something else, or is blurred"
    return f"{path.name}: its place could not be told, though it shares {matches} places with another photograph"
