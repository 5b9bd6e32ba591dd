"""One file of points or triangles becomes one `RawScan` in metres, whatever its format, and in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, InputError, require
from scan2fea.io import columns
from scan2fea.io.files import sha256_of
from scan2fea.io.formats import open_source
from scan2fea.io.gather import Gathered, gather
from scan2fea.io.lascrs import DEGREES
from scan2fea.io.source import Piece, Source
from scan2fea.kernel.push_broom import seen_from
from scan2fea.options import option
from scan2fea.types import ByteArray, FloatArray, IntArray, PointCloud, Scan, TriangleMesh, Value
from scan2fea.units import BYTES_PER_GIB, METRES_PER_UNIT, metres_per

# a point of the later chain: coordinates, ray, indices, normals, neighbours (about 15 of 8 bytes); and 56 more for the ray itself
BYTES_PER_POINT = 250
BYTES_PER_RAY = 56
# a face of a surface in repair and remeshing: its edges and their neighbours, boxes for crossings, a tree for distances
# (a torus of 102,400 and of 409,600 took 502 in repair, 617 and 623 with remeshing)
BYTES_PER_FACE = 650
_COARSE_M = 1e-3  # step of coordinates that no scan of a part has
_MOST_RINGS = 65536
CAPTURE = "pcap"  # the format whose files hold many turns


@dataclass(frozen=True, kw_only=True)
class InputOptions:
    """How an input file is understood."""

    unit: str = option("", "Unit of the coordinates. Empty: what the file states, else metres.", choices=("", *METRES_PER_UNIT))
    sensor_position: tuple[float, float, float] | None = option(
        None, "Where the points were seen from, in the frame and unit of the file; used where the file does not say it itself.", unit="input unit"
    )
    labels: str = option("", "Column that holds one label per point: its name, or its number counted from 1.")
    memory_gib: float = option(
        4.0, "A scan that would need more memory than this in the later steps is thinned to one point a voxel while it is read.", minimum=0.1
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class RawScan(Value):
    """What one file holds, in metres.

    scan : cloud (frame 0, raw_index = row in the file) and its rays; misses are rays that no point refers to.
    mesh : the triangles of a file with faces; its vertices are then the cloud.
    n_points : rows of the file that are points or misses.   n_dropped : rows that are not finite.   n_misses : rays without return.
    unit_source : "format", "option", "assumed", or "unknown" (no scale).   sensor : "known" or "unknown".
    pose_given : the file gave poses, and they are applied.   T_world_frame : None, or a (4, 4) pose that is not yet applied.
    voxel_edge_m : edge of the voxels of which one point each was kept, None where every point was.
    sweep : (n,) turn of the scanner that each point is of, where the file holds more than one.
    columns : names found.   notes : what was decided that the user did not ask for.
    acquired : figures of how the points were made, of inputs that hold none (pictures, logs); their first frame has it.
    """

    scan: Scan
    mesh: TriangleMesh | None
    path: str
    sha256: str
    format: str
    n_points: int
    n_dropped: int
    n_misses: int
    unit: str
    unit_source: str
    sensor: str
    pose_given: bool
    T_world_frame: FloatArray | None
    voxel_edge_m: float | None
    columns: tuple[str, ...]
    notes: tuple[str, ...]
    sweep: IntArray | None = None
    acquired: Mapping[str, Any] | None = None


def read_scan(path: Path, options: InputOptions = InputOptions()) -> RawScan:
    """Read a scan. Raises InputError, FormatError or EmptyScanError (one line: the file, the value, what to do), UsageError for options."""
    path = Path(path)
    if options.unit:
        metres_per(options.unit)
    entry, source = open_source(path)
    require(
        options.unit or source.unit != DEGREES,
        InputError,
        f"{path} holds degrees of longitude and latitude, not lengths: project it to a metric system (UTM) and export it again",
    )
    unit = options.unit or source.unit or "m"
    unit_source = "option" if options.unit else "format" if source.unit else "assumed"
    scale = metres_per(unit)
    labels = _label_columns(path, source, options.labels)
    wanted = _wanted(source, labels) + (("frame",) if entry.name == CAPTURE else ())
    limit = int(options.memory_gib * BYTES_PER_GIB / (BYTES_PER_POINT + BYTES_PER_RAY))
    try:
        gathered = gather(path, lambda: _with_sensor(source, wanted, options), wanted, scale, limit, keep_rows=source.faces is not None)
        mesh = _mesh(path, source, gathered, int(options.memory_gib * BYTES_PER_GIB / BYTES_PER_FACE))
    except MemoryError as error:
        raise InputError(f"{path} does not fit into memory: thin it, or lower input.memory_gib") from error
    usable = gathered.n_rows - gathered.n_dropped - gathered.n_misses
    if usable == 0:
        raise EmptyScanError(_nothing(path, gathered))
    label, note = _labels(path, gathered, labels, options.labels)
    scan = _scan(source, gathered, label)
    _refuse_pose(path, source, gathered)
    return RawScan(
        scan=scan,
        mesh=mesh,
        path=str(path),
        sha256=sha256_of(path),
        format=entry.name,
        n_points=gathered.n_rows,
        n_dropped=gathered.n_dropped,
        n_misses=gathered.n_misses,
        unit=unit,
        unit_source=unit_source,
        sensor="known" if scan.rays is not None and bool((scan.cloud.ray >= 0).any()) else "unknown",
        pose_given=source.pose_given,
        T_world_frame=None,
        voxel_edge_m=gathered.voxel_edge_m,
        columns=source.columns,
        sweep=_sweep(gathered),
        notes=(*source.notes, *gathered.notes, *note, *_told(entry.name, source, gathered, scan, scale, options)),
    )


def _told(form: str, source: Source, gathered: Gathered, scan: Scan, scale: float, options: InputOptions) -> tuple[str, ...]:
    return _surplus(form, source, gathered) + _sight_note(source, scan, options) + _precision_note(gathered.points, scale)


def _precision_note(points: FloatArray, scale: float) -> tuple[str, ...]:
    """Coordinates that single precision kept only to a millimetre or worse, as it does far from the origin.

    points : (n, 3), m.   scale : metres per unit of the file.
    """
    farthest = np.abs(points).max(axis=0) / scale
    step_m = float(np.spacing(np.float32(farthest.max()))) * scale
    if step_m < _COARSE_M:
        return ()
    column = points[:, int(farthest.argmax())] / scale
    is_single = np.abs(column - column.astype(np.float32)).max() <= 4.0 * np.spacing(farthest.max())
    says = f"coordinates as far from the origin as {farthest.max():,.0f} were kept in single precision, in steps of {1e3 * step_m:.3g} mm"
    return (f"{says}: export them in double precision, or with an offset taken off",) if is_single else ()


def _sight_note(source: Source, scan: Scan, options: InputOptions) -> tuple[str, ...]:
    """Places that nobody stated are told."""
    is_stated = options.sensor_position is not None or columns.find(source.columns, "sensor_x") is not None
    if is_stated or scan.rays is None or source.grid() is None:
        return ()
    away = float(np.nanmedian(scan.rays.range_m))
    return (f"the file is a range image whose rows meet {away:.3g} m before the points: they were taken as seen from there",)


def _sweep(gathered: Gathered) -> IntArray | None:
    turn = gathered.columns.get("frame")
    return None if turn is None or len(turn) == 0 or int(turn.max()) == int(turn.min()) else np.asarray(turn, np.int64)


def _surplus(form: str, source: Source, gathered: Gathered) -> tuple[str, ...]:
    """Rows beyond the count that a text file begins with are read, and told."""
    if form != "text" or source.n_points is None or gathered.n_rows == source.n_points:
        return ()
    return (f"the file promises {source.n_points} points and holds {gathered.n_rows}: all were read",)


def _wanted(source: Source, labels: tuple[str, ...]) -> tuple[str, ...]:
    """Columns to be read beside the coordinates, in the order of the file."""
    known = ("nx", "ny", "nz", "red", "green", "blue", "intensity", "sensor_x", "sensor_y", "sensor_z", "time", "ring")
    chosen = {columns.find(source.columns, name) for name in known} | set(labels)
    return tuple(name for name in source.columns if name in chosen)


def _with_sensor(source: Source, wanted: tuple[str, ...], options: InputOptions) -> Iterator[Piece]:
    """The pieces with a sensor position where columns or the options give one and the format does not, else where a range image tells it."""
    names = columns.find_all(source.columns, "sensor_x", "sensor_y", "sensor_z")
    pieces = source.pieces(frozenset(wanted))
    if names is None and options.sensor_position is None:
        pieces = _with_sight(source, pieces)
    for piece in pieces:
        sensor = piece.sensor
        if sensor is None and names is not None:
            sensor = np.stack([np.asarray(piece.columns[name], float) for name in names], axis=1)
        elif sensor is None and options.sensor_position is not None:
            sensor = np.asarray(options.sensor_position, float)
        yield Piece(points=piece.points, columns=piece.columns, sensor=sensor, is_miss=piece.is_miss, direction=piece.direction)


def _with_sight(source: Source, pieces: Iterator[Piece]) -> Iterator[Piece]:
    """The pieces with the places that a range image was seen from, where its grid tells them."""
    grid = source.grid()
    if grid is None:
        return pieces
    held = list(pieces)
    points = np.concatenate([piece.points for piece in held])
    if len(points) != len(grid[0]) or any(piece.sensor is not None for piece in held):
        return iter(held)
    sensor = seen_from(points, *grid)
    first = np.cumsum([0, *(len(piece.points) for piece in held)])
    return iter(held) if sensor is None else (replace(p, sensor=sensor[a : a + len(p.points)]) for a, p in zip(first, held, strict=False))


def _mesh(path: Path, source: Source, gathered: Gathered, limit: int) -> TriangleMesh | None:
    if source.faces is None:
        return None
    faces = source.faces()
    if len(faces) == 0:
        return None
    says = f"{path} has {len(faces)} faces, {limit} fit into input.memory_gib: raise it, or simplify the surface"
    require(len(faces) <= limit, InputError, says)
    n = len(gathered.points)
    require(
        int(faces.min()) >= 0 and int(faces.max()) < n,
        FormatError,
        f"{path}: a face refers to vertex {int(faces.max()) if int(faces.min()) >= 0 else int(faces.min())}, but there are {n}: export it again",
    )
    return TriangleMesh(vertices=gathered.points, faces=faces)


def _nothing(path: Path, gathered: Gathered) -> str:
    if gathered.n_rows == 0:
        return f"{path} holds no points: export it again"
    return (
        f"{path} holds no usable point: of {gathered.n_rows} rows {gathered.n_dropped} are not finite and {gathered.n_misses} are rays without return"
    )


def _refuse_pose(path: Path, source: Source, gathered: Gathered) -> None:
    """A 4 x 4 matrix lies in many a data set beside the scans and has the form of four points."""
    if gathered.n_rows == 4 and len(source.columns) == 4 and len(gathered.points) == 4 and gathered.columns:
        last = [*gathered.raw_points[3].tolist(), float(next(iter(gathered.columns.values()))[3])]
        require(last != [0.0, 0.0, 0.0, 1.0], InputError, f"{path} is a 4 x 4 pose, not a scan: give it with --poses, or leave it out")


def _label_columns(path: Path, source: Source, wanted: str) -> tuple[str, ...]:
    """Columns that may hold the labels, the likelier first."""
    names = source.columns
    if not wanted:
        found = columns.find(names, "label")
        return (found,) if found else ()
    same = [name for name in names if name.lower() == wanted.lower()] or [
        name for name in names if columns.canonical(name) == columns.canonical(wanted)
    ]
    if same:
        return (same[0],)
    if wanted.lstrip("-").isdigit():
        k = int(wanted)
        candidates = tuple(names[j] for j in (k - 1, k) if 0 <= j < len(names))
        if candidates:
            return candidates
    raise InputError(f"{path} has no column {wanted!r} for the labels: its columns are {', '.join(names)[:300]} (numbers count from 1)")


def _labels(path: Path, gathered: Gathered, candidates: tuple[str, ...], wanted: str) -> tuple[IntArray | None, tuple[str, ...]]:
    """Labels from the first candidate that holds whole numbers (-1 where a row has none)."""
    for place, name in enumerate(candidates):
        values = np.asarray(gathered.columns[name], float)
        missing = np.isnan(values)
        whole = np.where(missing, -1.0, values)
        if bool((np.floor(whole) == whole).all()) and bool((np.abs(whole) < 2.0**53).all()):
            counted_from_0 = place == 1
            note = f"labels: column {wanted} counted from 1 holds no whole numbers, so it was counted from 0 ({name})"
            return whole.astype(np.int64), (note,) if counted_from_0 else ()
    if not wanted:
        return None, (f"column {candidates[0]} holds no whole numbers and was not taken for labels",) if candidates else ()
    raise InputError(f"{path}: column {wanted} ({candidates[0]}) holds no whole numbers: name the column of the labels")


def _scan(source: Source, gathered: Gathered, label: IntArray | None) -> Scan:
    ray, rays = gathered.rays(*(_of_ray(source, gathered, name) for name in ("time", "ring")))
    return Scan(
        cloud=PointCloud(
            points=gathered.points,
            ray=ray,
            frame=np.zeros(len(gathered.points), np.int64),
            raw_index=gathered.raw_index,
            normals=_normals(source, gathered),
            colour=_colour(source, gathered),
            intensity=_intensity(source, gathered),
            label=label,
        ),
        rays=rays,
    )


def _of_ray(source: Source, gathered: Gathered, name: str) -> FloatArray | None:
    """Time or ring of each point; None where the file gives none, or one that is not finite."""
    found = columns.find(source.columns, name)
    if found is None or found not in gathered.columns:
        return None
    values = np.asarray(gathered.columns[found], float)
    return values if bool(np.isfinite(values).all()) and (name == "time" or bool((np.abs(values) < _MOST_RINGS).all())) else None


def _stacked(source: Source, gathered: Gathered, *names: str) -> FloatArray | None:
    found = columns.find_all(source.columns, *names)
    if found is None or any(name not in gathered.columns for name in found):
        return None
    return np.stack([np.asarray(gathered.columns[name], float) for name in found], axis=1)


def _normals(source: Source, gathered: Gathered) -> FloatArray | None:
    """Unit normals; nan where the file gives none that can be made unit."""
    normals = _stacked(source, gathered, "nx", "ny", "nz")
    if normals is None:
        return None
    length = np.sqrt((normals**2).sum(axis=1, keepdims=True))
    usable = np.isfinite(length) & (length > 0)
    return np.divide(normals, length, out=np.full_like(normals, np.nan), where=usable) if bool(usable.any()) else None


def _colour(source: Source, gathered: Gathered) -> ByteArray | None:
    """Bytes 0..255, from bytes, from 16-bit values (LAS, E57), or from shares 0..1; None where every point is black."""
    found = columns.find_all(source.columns, "red", "green", "blue")
    if found is None or any(name not in gathered.columns for name in found):
        return None
    channels = [gathered.columns[name] for name in found]
    largest = max(float(channel.max(initial=0)) for channel in channels)
    if not np.isfinite(largest) or largest <= 0:
        return None
    is_share = largest <= 1.0 and any(channel.dtype.kind == "f" and bool((channel % 1 != 0).any()) for channel in channels)
    factor = 255.0 if is_share else 1 / 257 if largest > 255 else 1.0
    colour = np.empty((len(channels[0]), 3), np.uint8)
    for k, channel in enumerate(channels):
        if channel.dtype == np.uint16:
            table = np.clip(np.rint(np.arange(65536) * factor), 0, 255).astype(np.uint8)
            colour[:, k] = table[channel]
        else:
            colour[:, k] = channel if channel.dtype == np.uint8 else np.clip(np.rint(channel * factor), 0, 255)
    return colour


def _intensity(source: Source, gathered: Gathered) -> FloatArray | None:
    name = columns.find(source.columns, "intensity")
    return np.asarray(gathered.columns[name], float) if name is not None and name in gathered.columns else None
