"""The words of the page, one line each; where docs/ says more, the page of it is named."""

GLOSSARY: tuple[tuple[str, str], ...] = (
    ("converted", "every check passed: closed surface, CAD solid, mesh and solved model describe the same shape, and the points lie on it."),
    ("failed", "at least one check did not pass; what was made so far is kept, and the reason says what is missing."),
    ("measured", "part of the surface with scanned points on it."),
    ("interpolated", "part of the surface between measured parts, close enough to them to be sure of."),
    ("invented", "part of the surface that nothing was measured on; it only closes the shape."),
    (
        "\u03c3 (sigma)",
        "standard deviation of the scanner's noise: two thirds of the points lie within one \u03c3 of the true surface, nearly all within three.",
    ),
    ("spacing", "median distance between neighbouring points."),
    ("deviation", "distance from a point to the surface, positive outside; 95 % is the distance that 95 of 100 points stay within."),
    ("observable", "a dimension that the data can tell; where they cannot, it is taken from a catalogue and said so."),
    ("CRB", "Cram\u00e9r-Rao bound: the smallest standard deviation any method could reach with these points and this noise."),
    ("Q1", "shortest edge / radius of the circumscribed sphere (circle); best 1.633 for a tetrahedron, 1.732 for a triangle."),
    (
        "Q2",
        "radius of the inscribed sphere (circle) / shortest edge; it rewards needles. Q2 corrected divides by the longest edge.",
    ),
    ("Q3", "radius of the inscribed / radius of the circumscribed sphere (circle); best 1/3, or 1/2 for a triangle."),
    ("Q4", "shortest / longest edge; best 1. Blind to flat slivers."),
    ("Q5", "volume / longest edge cubed (area / longest edge squared); best 0.118, or 0.433 for a triangle."),
    (
        "dihedral angle",
        "angle between two faces of a tetrahedron; near 0\u00b0 or 180\u00b0 it spoils the solution. The regular tetrahedron has 70.5\u00b0.",
    ),
    ("scaled Jacobian", "1 for the regular tetrahedron, 0 for a flat one, negative for one turned inside out."),
    ("C3D10, TET10", "tetrahedron with ten nodes and quadratic displacements."),
    ("mode", "shape in which the free body swings at one frequency; six modes at 0 Hz are its rigid motions."),
)

# word -> page of docs/ (the site has it as .html)
MORE: dict[str, str] = {
    "converted": "report",
    "invented": "report",
    "observable": "estimation",
    "CRB": "simulation",
    "Q1": "meshing",
    "dihedral angle": "meshing",
    "C3D10, TET10": "fea",
    "mode": "fea",
    "spacing": "sensors",
    "deviation": "report",
    "\u03c3 (sigma)": "sensors",
}
