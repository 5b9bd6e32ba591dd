"""What a scan will tell, before it is made

Two stations are planned for an angle. `plan` casts their rays at the exact solid and says how much of it they will see, and the smallest standard
deviation that any method can reach for each dimension.
"""

from kit import Kit

SCENE = """\
name = "angle"

[[object]]
name = "angle"
kind = "L"
a = "5 in"
b = "5 in"
t = "0.25 in"
length = "2 m"
position = [0, 0, 1]
rotation_deg = [90, 0, 90]
spacing = "8 mm"

[[sensor]]
kind = "terrestrial"
positions_m = [[-1.5, -2, 1.6], [1, 2.5, 0.4]]
noise_m = "2 mm"
"""


def example(kit: Kit) -> None:
    """Both legs are told; the scan itself is simulated for the picture."""
    scene = kit.write("angle.toml", SCENE)
    told = kit.scan2fea("plan", scene)
    assert "a = 127 mm: observable" in told
    scans = kit.folder / "SCANS"
    kit.scan2fea("simulate", scene, "-o", scans, "--no-step")
    kit.picture = (scans / "scene.png").read_bytes()
