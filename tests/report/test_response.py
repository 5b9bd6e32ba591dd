from scan2fea.report.response import response_section

TIP = {"name": "bend_x", "measure": "tip_x_m", "unit": "m", "value": 6.1e-4, "expected": 6.2e-4, "relative_error": 0.016, "std": None}


def page(*cases):
    return str(response_section({"fea": {"cases": list(cases)}, "checks": []}))


def test_shells_stand_beside_the_solid_and_the_beam_and_not_among_the_cases():
    shell = {**TIP, "name": "shell_bend_x", "value": 6.3e-4, "expected": None, "relative_error": None}
    text = page(TIP, shell)
    assert text.count("bend x: tip x") == 2 and "shell bend" not in text
    own = text[text.index("Three models") :]
    assert [own.index(value) for value in ("0.61 mm", "0.63 mm", "0.62 mm")] == sorted(own.index(v) for v in ("0.61 mm", "0.63 mm", "0.62 mm"))
    assert "Three models" not in page(TIP) and "Three models" not in page(shell)


def test_sets_of_faces_show_no_rounding():
    row = {"name": "END", "area_m2": 1e-4, "centre_m": [1.2, -1.2e-35, 3e-9], "normal": [1.0, -1.2e-32, 0.0049]}
    text = str(response_section({"fea": {"cases": [TIP], "sets": [row]}, "checks": []}))
    assert "1\u202f200, 0, 0" in text and "1, 0, 0" in text and "10\u207b" not in text
    hole = {**row, "normal": [-3.3e-12, -6e-12, -4.1e-8]}
    assert ">0, 0, 0<" not in str(response_section({"fea": {"cases": [TIP], "sets": [hole]}, "checks": []}))


def test_every_figure_with_an_expected_one_has_a_verdict():
    assert "compared, not checked" in page({**TIP, "name": "buckling", "measure": "buckling_n"})
    for change, verdict in ((0.02, "\u2713 \u2264 2 %"), (0.021, "\u2713 \u2264 5 %"), (0.051, "\u2717 &gt; 5 %")):
        figure = {"name": "self_weight", "measure": "discretisation", "unit": "share", "value": change}
        assert verdict in page(figure)
    check = {"name": "response.member_twist", "limit": 0.15}
    twist = {**TIP, "measure": "twist_rad", "unit": "rad"}
    assert "\u2713 \u2264 15 %" in str(response_section({"fea": {"cases": [twist]}, "checks": [check]}))
