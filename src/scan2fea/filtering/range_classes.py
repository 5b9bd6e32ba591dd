"""Classes of a histogram of ranges, merged where their middles are near (thesis eq 2.5 and 2.6, after Biasutti et al. 2017).

A histogram is taken of every window of one row: there a surface is one narrow heap, and what stands before it another. A class is a run of bins
without a gap. Its middle is C_s = sum b h(b) / sum h(b) over the bins b of class s (eq 2.5); classes of neighbouring windows are one where
|C_s - C_r| <= tau (eq 2.6; "<= tau" is missing in the thesis), or where the ranges on both sides of the border between them continue each other.
"""

from __future__ import annotations

import numpy as np

from scan2fea.filtering.range_image import RangeImage
from scan2fea.kernel.jit import jit
from scan2fea.kernel.union_find import join, root
from scan2fea.types import FloatArray, IntArray

WINDOW = 32  # columns


def classes(image: RangeImage, tau_m: FloatArray) -> IntArray:
    """(rows, columns) class of each cell, numbered from 0 within its row; -1 where nothing came back.

    tau_m : (rows, columns) what two ranges of one surface may differ by, also the bin of the histograms.
    """
    label = np.full(image.range_m.shape, -1, np.int64)
    _classified(image.range_m, tau_m, image.is_closed, WINDOW, label)
    return label


@jit
def _classified(ranges: FloatArray, tau: FloatArray, is_closed: bool, window: int, label: IntArray) -> None:
    n_rows, n_columns = ranges.shape
    for row in range(n_rows):
        parent = np.arange(n_columns + 1)
        middle = np.full(n_columns + 1, np.nan)
        first_of_window = np.zeros(n_columns // window + 2, np.int64)
        n = 0
        n_windows = 0
        for start in range(0, n_columns, window):
            first_of_window[n_windows] = n
            n_windows += 1
            n = _one_window(ranges[row], tau[row], start, min(start + window, n_columns), n, middle, label[row])
        first_of_window[n_windows] = n
        for k in range(n_windows if is_closed else n_windows - 1):
            after = (k + 1) % n_windows
            for s in range(first_of_window[k], first_of_window[k + 1]):
                for r in range(first_of_window[after], first_of_window[after + 1]):
                    near = tau[row, min(k * window, n_columns - 1)]
                    if abs(middle[s] - middle[r]) <= near:
                        join(parent, s, r)
            left = _last(label[row], k * window, min((k + 1) * window, n_columns))
            right = _first(label[row], after * window, min((after + 1) * window, n_columns))
            if left >= 0 and right >= 0 and abs(ranges[row, left] - ranges[row, right]) <= tau[row, left]:
                join(parent, label[row, left], label[row, right])
        for column in range(n_columns):
            if label[row, column] >= 0:
                label[row, column] = root(parent, label[row, column])


@jit
def _one_window(ranges: FloatArray, tau: FloatArray, start: int, stop: int, n: int, middle: FloatArray, label: IntArray) -> int:
    """Label the cells of one window by runs of bins; returns the number of classes so far."""
    values = ranges[start:stop]
    order = np.argsort(values)  # nan comes last
    total, count = 0.0, 0
    for k in range(len(order)):
        r = values[order[k]]
        if np.isnan(r):
            break
        if count > 0 and r - values[order[k - 1]] > tau[start + order[k]]:  # an empty bin
            middle[n] = total / count
            n += 1
            total, count = 0.0, 0
        label[start + order[k]] = n
        total += r
        count += 1
    if count > 0:
        middle[n] = total / count
        n += 1
    return n


@jit
def _last(label: IntArray, start: int, stop: int) -> int:
    for column in range(stop - 1, start - 1, -1):
        if label[column] >= 0:
            return column
    return -1


@jit
def _first(label: IntArray, start: int, stop: int) -> int:
    for column in range(start, stop):
        if label[column] >= 0:
            return column
    return -1
