from scan2fea.pipeline.results import _not_solved


def test_cases_without_a_result_are_in_the_line_of_the_verdict():
    assert _not_solved({}) == ""
    said = _not_solved({"a": "case a: the model has no set TOP", "b": "case b: the model has no set TOP", "member": "no end"})
    assert said == "; not solved: a, b (the model has no set TOP); not solved: member (no end)"
