"""A bracket with bores to a checked model

A free form: points on a bracket with two bores, 0.2 mm of noise. `run` finds its planes and cylinders, makes a solid of true faces, a
mesh and a deck, solves it and checks all of it against the points. The picture is one of the report: the faces, named as in the deck.
"""

from kit import Kit

SCENE = """\
name = "bracket"

[[object]]
name = "bracket"
kind = "bracket"
a = "120 mm"
b = "100 mm"
t = "12 mm"
width = "80 mm"
holes = [{ leg = "a", along = "70 mm", z = "40 mm", d = "22 mm" }, { leg = "b", along = "60 mm", z = "40 mm", d = "18 mm" }]

[sampling]
method = "blue_noise"
spacing_m = "2.5 mm"
noise_m = "0.2 mm"
"""


def example(kit: Kit) -> None:
    """It converts, its volume is that of the bracket, and both bores are cylinders."""
    scans, out = kit.folder / "SCANS", kit.folder / "OUT"
    kit.scan2fea("simulate", kit.write("bracket.toml", SCENE), "-o", scans, "--no-step")
    kit.scan2fea("run", scans / "surface.ply", "-o", out)
    kit.report_picture(out, "CAD faces")
    row, truth = kit.json("OUT/report.json")["objects"][0], kit.json("SCANS/truth.json")["objects"][0]
    assert row["verdict"] == "converted" and row["cad"]["n_cylindrical"] >= 2
    assert abs(row["surface"]["volume_m3"] / truth["volume_m3"] - 1) < 0.01
