"""A figure of the source thesis

Each table and figure of the thesis is made by its own number: here figure 2.20, what 1, 5, 10 and 15 relaxations do to a mesh.
"""

from kit import Kit


def example(kit: Kit) -> None:
    """One picture, and a page that tells what was run."""
    out = kit.folder / "THESIS"
    kit.scan2fea("thesis", "-o", out, "--only", "F2.20", "--quick")
    kit.picture = (out / "F2.20.png").read_bytes()
    assert (out / "thesis.html").is_file()
