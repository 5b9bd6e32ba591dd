"""Points that no sensor measured, put beside those of a cloud."""

from __future__ import annotations

import dataclasses

import numpy as np

from scan2fea.types import FloatArray, PointCloud

FILLER = {"ray": -1, "frame": -1, "raw_index": -1, "normals": np.nan, "sigma_along_m": np.nan, "sigma_across_m": np.nan, "is_inferred": True,
          "intensity": np.nan, "label": -1, "colour": 128}  # fmt: skip


def with_inferred(cloud: PointCloud, points: FloatArray, normals: FloatArray, **given: np.typing.ArrayLike) -> PointCloud:
    """Both, the inferred points last.

    points : (k, 3).   normals : (k, 3) outward, or one of all.   given : further columns of the inferred points, (k,) or one value of all; what is
    not given says nothing (nan, -1, grey), and a column that the cloud lacks says nothing of the measured ones.
    """
    n, k = len(cloud), len(points)
    empty = {"normals": np.full((n, 3), np.nan), "is_inferred": np.zeros(n, bool), "sigma_along_m": np.full(n, np.nan)}
    values = {"normals": normals, "is_inferred": True, **given}
    columns = {"points": np.concatenate([cloud.points, points])}
    for field in dataclasses.fields(cloud):
        own = getattr(cloud, field.name)
        own = empty.get(field.name) if own is None and field.name in values else own
        if field.name != "points" and own is not None:
            new = np.broadcast_to(np.asarray(values.get(field.name, FILLER[field.name]), own.dtype), (k, *own.shape[1:]))
            columns[field.name] = np.concatenate([own, new])
    return PointCloud(**columns)
