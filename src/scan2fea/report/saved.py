"""What a run left in OUT, read as it is needed. A file that is missing or damaged is told, and the page goes on without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from scan2fea.errors import Scan2FeaError
from scan2fea.report.ours import read_as_built, read_cloud, read_solid, read_surface
from scan2fea.report.solids import Solid
from scan2fea.report.words import number_of
from scan2fea.types import FloatArray, PointCloud, TriangleMesh, Value

T = TypeVar("T")


@dataclass(frozen=True, eq=False, kw_only=True)
class Geometry(Value):
    """What there is of one object. size_m : extent along x, y and z, or None where there are no points.

    as_built : (n, 3) points and (n,) how far they lie off the drawing, where one was given.
    """

    cloud: PointCloud | None
    surface: TriangleMesh | None
    solid: Solid | None
    size_m: tuple[float, ...] | None
    as_built: tuple[FloatArray, FloatArray] | None = None


@dataclass(kw_only=True)
class Saved:
    """The folder OUT of a run. `troubles` collects what could not be read, for the page to say."""

    out: Path
    report: Mapping[str, Any]
    troubles: list[str] = field(default_factory=list)

    def folder(self, item: Mapping[str, Any]) -> str:
        """The object's folder, relative to OUT."""
        return f"objects/{number_of(item)}"

    def exists(self, relative: str) -> bool:
        return (self.out / relative).is_file()

    def files(self, item: Mapping[str, Any]) -> list[str]:
        """The object's files that are really there, relative to OUT, in the order of the record."""
        listed = [name if "/" in name else f"{self.folder(item)}/{name}" for name in item.get("files") or []]
        return [name for name in listed if self.exists(name)]

    def scene(self) -> PointCloud | None:
        return self._read("cloud.ply", read_cloud)

    def cloud(self, item: Mapping[str, Any]) -> PointCloud | None:
        return self._read(f"{self.folder(item)}/cloud.ply", read_cloud)

    def surface(self, item: Mapping[str, Any]) -> TriangleMesh | None:
        """The object's surface, or the open sheet where it became no solid."""
        return self._read(f"{self.folder(item)}/surface.ply", read_surface) or self._read(f"{self.folder(item)}/sheet.ply", read_surface)

    def solid(self, item: Mapping[str, Any]) -> Solid | None:
        return self._read(f"{self.folder(item)}/volume.vtu", read_solid)

    def geometry(self, item: Mapping[str, Any], cloud: PointCloud | None) -> Geometry:
        """All of one object; its cloud is given since the overview needs it too."""
        surface = self.surface(item)
        built = self._read(f"{self.folder(item)}/as_built.ply", read_as_built)
        return Geometry(cloud=cloud, surface=surface, solid=self.solid(item), size_m=_size(item, cloud, surface), as_built=built)

    def _read(self, relative: str, reader: Callable[[Path], T]) -> T | None:
        if not self.exists(relative):
            return None
        try:
            return reader(self.out / relative)
        except (Scan2FeaError, OSError) as error:
            self.troubles.append(f"{relative} could not be drawn: {error}")
            return None


def _size(item: Mapping[str, Any], cloud: PointCloud | None, surface: TriangleMesh | None) -> tuple[float, ...] | None:
    """As recorded, else that of the surface, else that of the points."""
    if item.get("size_m"):
        return tuple(float(x) for x in item["size_m"])
    points = np.zeros((0, 3)) if cloud is None else cloud.points
    if surface is not None and len(surface.faces):
        points = surface.vertices[np.unique(surface.faces)]
    if len(points) < 3:
        return None
    return tuple(np.ptp(points, axis=0).tolist())
