"""The compiled half of `io.numbers`: lines, values and numbers out of bytes.

A number of up to 18 digits and a power of ten up to 22 is converted in double-double arithmetic (Dekker 1971: exact product and remainder) and
kept only where the result cannot depend on the last bits; every other token is left to Python's own `float`.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray

WHITESPACE = 0  # the separator that stands for runs of blanks
FULL, END, FEW, MANY = 0, 1, 2, 3  # how `parse_rows` ended: rows or odd tokens full, text at its end, too few or too many values in a line

_POWERS = np.array([10.0**k for k in range(23)])  # exact in float64
_SPLIT = 134217729.0  # 2^27 + 1, Veltkamp
_LF, _TAB, _QUOTE, _HASH, _SLASH, _PERCENT = 10, 9, 34, 35, 47, 37


def _bytes(characters: bytes) -> BoolArray:
    table = np.zeros(256, np.bool_)
    table[list(characters)] = True
    return table


_BLANK = _bytes(b" \t\r\n")  # between values that blanks separate
_PADDING = _bytes(b' \r"')  # around values that a character separates


@jit
def _product_error(a: float, b: float, p: float) -> float:
    """a b - p exactly, for p = fl(a b)."""
    t = _SPLIT * a
    ah = t - (t - a)
    al = a - ah
    t = _SPLIT * b
    bh = t - (t - b)
    bl = b - bh
    return ((ah * bh - p) + ah * bl + al * bh) + al * bl


@jit
def _scaled(mantissa: int, exponent: int) -> tuple[float, bool]:
    """Mantissa times ten to the exponent, and whether that is certainly the nearest float64."""
    high = float(mantissa >> 32) * 4294967296.0
    low = float(mantissa & 0xFFFFFFFF)
    a = high + low
    rest = low - (a - high)
    if exponent == 0 or mantissa == 0:
        return a, True
    if exponent > 22 or exponent < -22:
        return 0.0, False
    if exponent > 0:
        p = _POWERS[exponent]
        q = a * p
        correction = _product_error(a, p, q) + rest * p
    else:
        p = _POWERS[-exponent]
        q = a / p
        product = q * p
        correction = ((a - product) - _product_error(q, p, product) + rest) / p
    doubt = abs(correction) * 1e-15 + abs(q) * 1e-30
    value = q + correction
    return value, q + (correction + doubt) == value and q + (correction - doubt) == value


@jit
def _power(text: ByteArray, k: int, stop: int) -> tuple[int, bool]:
    """The whole number of up to four digits and a sign in text[k:stop], and whether it is one."""
    sign = 1
    if k < stop and (text[k] == 45 or text[k] == 43):
        sign = -1 if text[k] == 45 else 1
        k += 1
    if k == stop or stop - k > 4:
        return 0, False
    power = 0
    for j in range(k, stop):
        if text[j] < 48 or text[j] > 57:
            return 0, False
        power = power * 10 + (int(text[j]) - 48)
    return sign * power, True


@jit
def _number(text: ByteArray, start: int, stop: int, point: int) -> tuple[float, bool]:
    """The number that fills text[start:stop], and whether it was read; `point` is the decimal sign."""
    k = start
    negative = False
    if k < stop and (text[k] == 45 or text[k] == 43):
        negative = text[k] == 45
        k += 1
    mantissa, exponent, digits, fraction = 0, 0, 0, 0
    while k < stop:
        c = int(text[k])
        if 48 <= c <= 57 and mantissa <= 922337203685477570:
            digits += 1
            mantissa = mantissa * 10 + (c - 48)
            exponent -= fraction
        elif c == point and fraction == 0:
            fraction = 1
        else:
            break
        k += 1
    readable = digits > 0
    if k < stop and readable:
        readable = text[k] in (69, 101, 68, 100)  # e, or the d of Fortran
        if readable:
            power, readable = _power(text, k + 1, stop)
            exponent += power
    value, certain = _scaled(mantissa, exponent)
    return -value if negative else value, certain and readable


@jit
def _token(text: ByteArray, k: int, stop: int, separator: int) -> tuple[int, int, int]:
    """Bounds of the next value of a line from k on, and where the scan stopped: on the separator, the blank after it, or the end of the line."""
    while k < stop and (_PADDING[text[k]] or (text[k] == _TAB and separator != _TAB)):
        k += 1
    first = k
    if separator == 0:
        while k < stop and not _BLANK[text[k]]:
            k += 1
        last = k - 1 if k > first and text[k - 1] == _QUOTE else k
        return first, last, k
    while k < stop and text[k] != _LF and text[k] != separator:
        k += 1
    last = k
    while last > first and (_PADDING[text[last - 1]] or text[last - 1] == _TAB):
        last -= 1
    return first, last, k


@jit
def _line_start(text: ByteArray, k: int, stop: int, separator: int) -> int:
    """Start of the next line that holds values: blank lines and those that begin with #, % or // are passed over."""
    while k < stop:
        c = text[k]
        if _BLANK[c] and (c != _TAB or separator != _TAB):
            k += 1
        elif c == _HASH or c == _PERCENT or (c == _SLASH and k + 1 < stop and text[k + 1] == _SLASH):  # noqa: SIM109 (numba is faster so)
            while k < stop and text[k] != _LF:
                k += 1
        else:
            break
    return k


@jit
def _line_end(text: ByteArray, k: int, stop: int, separator: int) -> tuple[int, bool]:
    """Start of the next line, seen from the end of the last value, and whether nothing but a comment stood between."""
    if separator != 0 and k < stop and text[k] == separator:
        k += 1  # one separator may end a line
    first, last, k = _token(text, k, stop, separator)
    is_clean = last == first or text[first] == _HASH
    while k < stop and text[k] != _LF:
        k += 1
    return k + 1, is_clean


@jit
def parse_rows(
    text: ByteArray, start: int, stop: int, separator: int, point: int, keep: IntArray, out: FloatArray, odd: IntArray
) -> tuple[int, int, int, int]:
    """Fill rows of `out` from lines; returns (next position, rows, odd tokens, how it ended).

    keep : (columns,) column of `out` for each value of a line, -1 where it is passed over.
    odd : (k, 4) row, column and bounds of the tokens left to Python.
    """
    columns = len(keep)
    rows, n_odd, position = 0, 0, start
    while True:
        position = _line_start(text, position, stop, separator)
        if position >= stop:
            return stop, rows, n_odd, END
        if rows == len(out) or n_odd + columns > len(odd):
            return position, rows, n_odd, FULL
        k = position
        for column in range(columns):
            first, last, k = _token(text, k, stop, separator)
            is_cut = first == last if separator == 0 else column + 1 < columns and (k >= stop or text[k] == _LF)
            if is_cut:
                return position, rows, n_odd, FEW
            if keep[column] >= 0:
                out[rows, keep[column]], certain = _number(text, first, last, point)
                if not certain:
                    odd[n_odd, 0], odd[n_odd, 1], odd[n_odd, 2], odd[n_odd, 3] = rows, column, first, last
                    n_odd += 1
            if separator != 0 and column + 1 < columns:
                k += 1
        following, is_clean = _line_end(text, k, stop, separator)
        if not is_clean:
            return position, rows, n_odd, MANY
        rows += 1
        position = following


@jit
def parse_flat(text: ByteArray, start: int, stop: int, out: FloatArray, odd: IntArray) -> tuple[int, int, int]:
    """Numbers between blanks, whatever the lines; returns (next position, numbers, odd tokens). Text after # is passed over."""
    n, n_odd = 0, 0
    k = start
    while True:
        k = _line_start(text, k, stop, 0)
        if k >= stop or n == len(out) or n_odd == len(odd):
            return k, n, n_odd
        first = k
        while k < stop and not _BLANK[text[k]] and text[k] != _HASH:
            k += 1
        out[n], certain = _number(text, first, k, 46)
        if not certain:
            odd[n_odd, 0], odd[n_odd, 2], odd[n_odd, 3] = n, first, k
            n_odd += 1
        n += 1
