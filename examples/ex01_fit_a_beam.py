"""The dimensions of one beam

Points on an I-beam with 2 mm of noise, a third of its web. `fit` tells every dimension with its standard deviation, and which standard section it is
likely to be; nothing is snapped to it.
"""

from kit import Kit

SCENE = """\
name = "beam"

[[object]]
name = "beam"
kind = "I"
h = "200 mm"
b = "100 mm"
tw = "5.6 mm"
tf = "8.5 mm"
length = "1.2 m"
rotation_deg = [90, 0, 30]

[sampling]
method = "uniform"
spacing_m = "8 mm"
noise_m = "2 mm"
"""
TRUE_MM = {"h": 200.0, "b": 100.0, "length": 1200.0}


def example(kit: Kit) -> None:
    """What is told of the outer sizes is within four standard deviations of the truth."""
    scans = kit.folder / "SCANS"
    kit.scan2fea("simulate", kit.write("beam.toml", SCENE), "-o", scans, "--no-step")
    kit.picture = (scans / "scene.png").read_bytes()
    kit.scan2fea("fit", scans / "surface.ply", "-o", kit.folder / "beam.json")
    found = kit.json("beam.json")["parameters"]
    for name, true in TRUE_MM.items():
        value, std = 1e3 * found[name]["value_m"], 1e3 * found[name]["std_m"]
        assert abs(value - true) < 4 * std < 4, f"{name} = {value} +- {std}, not {true}"
