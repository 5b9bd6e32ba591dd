"""The objects of a room

The room of `scan2fea demo`, scanned from thirteen places. `segment` takes the floor away and separates what stands on it; `labels.csv` can be edited
and given back to `run`.
"""

from kit import Kit


def example(kit: Kit) -> None:
    """Nine objects and the floor."""
    scans, out = kit.folder / "SCANS", kit.folder / "OUT"
    kit.scan2fea("simulate", "demo", "-o", scans, "--no-step")
    kit.scan2fea("segment", *sorted(scans.glob("*.ply")), "-o", out)
    kit.picture = next(out.glob("*.png")).read_bytes()
    assert len([row for row in kit.json("OUT/report.json")["segments"] if row.get("object")]) == 9
