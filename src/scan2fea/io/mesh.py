"""Surface and volume meshes in, for `scan2fea check`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from scan2fea.errors import FormatError, InputError, require
from scan2fea.io.files import existing_file
from scan2fea.io.formats import BY_SUFFIX
from scan2fea.io.inp import read_inp
from scan2fea.io.msh_reader import read_msh
from scan2fea.io.scan import InputOptions, read_scan
from scan2fea.io.volume import Blocks, mesh_of
from scan2fea.io.vtu import read_vtu
from scan2fea.types import TetMesh, TriangleMesh
from scan2fea.units import metres_per

VOLUMES: Mapping[str, Callable[[Path, int], Blocks]] = {".vtu": read_vtu, ".msh": read_msh, ".inp": read_inp}
_SURFACES = (".ply", ".stl", ".obj", ".off")


def read_mesh(path: Path, unit: str = "") -> TriangleMesh | TetMesh:
    """A mesh in metres: STL, OBJ, OFF, PLY, or VTU, MSH, INP. Raises InputError, FormatError or EmptyScanError in one line."""
    path = Path(path)
    suffix = path.suffix.lower()
    size = existing_file(path)
    if suffix in VOLUMES:
        return mesh_of(VOLUMES[suffix](path, size), metres_per(unit or "m"))
    known = ", ".join(sorted((*VOLUMES, *_SURFACES)))
    require(suffix in BY_SUFFIX, FormatError, f"{path}: suffix {suffix or '(none)'} is not known: meshes are {known}")
    mesh = read_scan(path, InputOptions(unit=unit)).mesh
    if mesh is None:
        raise InputError(f"{path} holds points without faces: a mesh is needed ({known})")
    return mesh
