"""Files in and out: `read_scan` for every format of points and triangles, writers for every file of OUT, `artifacts` for values."""

from __future__ import annotations

from scan2fea.io.scan import InputOptions, RawScan, read_scan

__all__ = ["InputOptions", "RawScan", "read_scan"]
