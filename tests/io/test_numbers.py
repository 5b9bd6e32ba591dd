"""Numbers out of text equal Python's own float to the last bit."""

from fractions import Fraction

import numpy as np
import pytest

from scan2fea.errors import FormatError
from scan2fea.io.numbers import TextTable, flat_numbers, number


def table(text, columns, separator=0, point="."):
    data = np.frombuffer(text if isinstance(text, bytes) else text.encode(), np.uint8)
    return TextTable("f.xyz", data, 0, len(data), separator if isinstance(separator, int) else ord(separator), ord(point), columns)


def read(text, columns, separator=0, point=".", limit=100_000):
    return table(text, columns, separator, point).rows(0, limit, tuple(range(columns)))[0]


def halfway(rng):
    """17 to 19 digits at, just above and just below the middle between two floats: where rounding is decided."""
    x = float(rng.random() * 10.0 ** int(rng.integers(-3, 4)))
    middle = (Fraction(x) + Fraction(np.nextafter(x, np.inf).item())) / 2
    digits = int(rng.integers(16, 19))
    shift = digits - len(str(int(middle)))
    scaled = round(middle * 10**shift) + int(rng.integers(-1, 2))
    return f"{scaled}e-{shift}"


@pytest.mark.parametrize("form", ["%.3f", "%.6f", "%.9g", "%.15g", "%.17g", "%.18e", "%r", "%d", "half"])
def test_every_number_is_the_nearest_float(form):
    rng = np.random.default_rng(7)
    values = rng.normal(size=4000) * 10.0 ** rng.integers(-12, 13, 4000)
    words = [halfway(rng) for _ in values] if form == "half" else [repr(v) if form == "%r" else form % v for v in values.tolist()]
    assert read("\n".join(words), 1)[:, 0].tolist() == [float(word) for word in words]


WORDS = ["0", "-0", "+1", ".5", "5.", "-.5e1", "1e22", "1e23", "1e-22", "1e-23", "1E5", "9007199254740993", "123456789012345678901234567890",
         "4.9e-324", "1.7976931348623157e308", "1e400", "00012", "0.1e-5", "inf", "-Inf", "9223372036854775807", "9223372036854775809"]  # fmt: skip


@pytest.mark.parametrize("word", WORDS)
def test_odd_words(word):
    value = read(word + "\n", 1)[0, 0]
    assert value == float(word) and np.signbit(value) == np.signbit(float(word))


def test_fortran_missing_and_words():
    assert number(b"1.5D+03") == 1500.0 and read("1.5d3\n", 1)[0, 0] == 1500.0
    assert np.isnan(number(b"NaN")) and np.isnan(number(b"-1.#IND")) and np.isnan(number(b""))
    assert number(b"1_000") is None and number(b"abc") is None and number(b"1,5", ",") == 1.5


@pytest.mark.parametrize("text, separator, point", [
    ("1 2 3\n4 5 6\n", 0, "."), ("1 2 3\n4 5 6", 0, "."), ("  1\t2  3 \r\n\r\n4 5 6\r\n", 0, "."), ("# a\n1 2 3 # b\n// c\n4 5 6\n% d\n", 0, "."),
    ("1,2,3\n4,5,6\n", ",", "."), ("1 , 2 ,3,\n4,5, 6 , \n", ",", "."), ('"1","2","3"\n"4","5","6"\n', ",", "."), ("1,0;2,0;3\n4;5;6\n", ";", ","),
    ("1\t2\t3\n4\t5\t6\n", "\t", "."), ("1|2|3\n\n4|5|6\n", "|", "."), ('"1" "2" "3"\n4 5 6\n', 0, "."),
])  # fmt: skip
def test_separators(text, separator, point):
    assert read(text, 3, separator, point).tolist() == [[1, 2, 3], [4, 5, 6]]


def test_empty_fields_are_nan():
    got = read("1,,3\n4,5,\n", 3, ",")
    np.testing.assert_array_equal(got, [[1, np.nan, 3], [4, 5, np.nan]])


@pytest.mark.parametrize("text, separator, said", [
    ("1 2 3\n4 5\n", 0, "line 2: 2 values where 3 are expected, too few"),
    ("1 2 3\n\n# c\n4 5 6 7\n", 0, "line 4: 4 values where 3 are expected, too many"),
    ("1,2,3\n4,5\n", ",", "line 2: 2 values where 3"),
    ("1,2,3\n4,5,6,7\n", ",", "line 2: 4 values where 3"),
    ("1 2 3\n4 x5 6\n", 0, "line 2: 'x5' in column 2 is not a number"),
    ("1 2 3\n4 --5 6\n", 0, "line 2: '--5' in column 2"),
    ("1 2 3\n4 5e 6\n", 0, "line 2: '5e' in column 2"),
    ("1 2 3\n4 5.5.5 6\n", 0, "line 2: '5.5.5' in column 2"),
    ("1 2 3\n4 " + "5" * 300 + "x 6\n", 0, r"line 2: '5555.*\.\.\.' in column 2"),
])  # fmt: skip
def test_says_which_line_is_at_fault(text, separator, said):
    with pytest.raises(FormatError, match=said):
        read(text, 3, separator)


def test_rows_in_pieces_equal_the_whole():
    text = "\n".join(f"{k}.25 {k * 1e-30!r} {-k}" for k in range(5000))
    lines, whole, position, parts = table(text, 3), read(text, 3), 0, []
    while len(part := lines.rows(position, 777, (0, 2))[0]):
        parts.append(part)
        position = lines.rows(position, 777, (0, 2))[1]
    assert np.concatenate(parts).tobytes() == np.ascontiguousarray(whole[:, [0, 2]]).tobytes()


def test_flat_numbers():
    data = np.frombuffer(b"OFF 1 2\n# no\n3.5\t4e1 5#x\n6\n", np.uint8)
    values, position = flat_numbers("f", data, 3, len(data), 4)
    assert values.tolist() == [1, 2, 3.5, 40] and flat_numbers("f", data, position, len(data), 99)[0].tolist() == [5, 6]
    with pytest.raises(FormatError, match="line 1: 'OFF' is not a number"):
        flat_numbers("f", data, 0, len(data), 4)
