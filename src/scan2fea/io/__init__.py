"""Files in and out: `read_scan` for every format of points and triangles, writers for every file of OUT, `artifacts` for values."""

from __future__ import annotations

from scan2fea.io.files import write_text
from scan2fea.io.mesh import read_mesh
from scan2fea.io.msh import write_msh
from scan2fea.io.ply_writer import write_cloud_ply, write_mesh_ply, write_scan_ply
from scan2fea.io.scan import InputOptions, RawScan, read_scan
from scan2fea.io.stl import write_stl
from scan2fea.io.trajectory import write_trajectory
from scan2fea.io.vtu import write_vtu

__all__ = [
    "InputOptions",
    "RawScan",
    "read_mesh",
    "read_scan",
    "write_cloud_ply",
    "write_mesh_ply",
    "write_msh",
    "write_scan_ply",
    "write_stl",
    "write_text",
    "write_trajectory",
    "write_vtu",
]
