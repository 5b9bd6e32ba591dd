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
