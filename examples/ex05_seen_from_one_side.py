"""A plate of which one side was scanned

Nobody can tell the thickness of a plate from one of its faces, and no model is made up: the run ends with exit code 4, and the report says what is
missing and what to do.
"""

from kit import Kit

SCENE = """\
name = "plate"

[[object]]
name = "plate"
kind = "plate"
b = "400 mm"
t = "10 mm"
length = "600 mm"
spacing = "6 mm"

[[sensor]]
kind = "terrestrial"
positions_m = [[0.1, 3, 0.3]]
noise_m = "0.5 mm"
"""


def example(kit: Kit) -> None:
    """It is refused, with a reason."""
    scans, out = kit.folder / "SCANS", kit.folder / "OUT"
    kit.scan2fea("simulate", kit.write("plate.toml", SCENE), "-o", scans, "--no-step")
    kit.scan2fea("run", *sorted(scans.glob("*.ply")), "-o", out, code=4)
    row = kit.json("OUT/report.json")["objects"][0]
    assert row["verdict"] == "failed" and row["reason"]
    kit.steps.append(("", f"{row['reason']}"))
    kit.report_picture(out, "The scene")
