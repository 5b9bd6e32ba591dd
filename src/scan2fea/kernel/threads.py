"""Independent work on all cores of the machine; numpy, scipy's trees and our kernels let other threads run while they work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def in_threads(function: Callable[[T], R], items: Iterable[T], at_most: int | None = None) -> list[R]:
    """[function(item) for item in items], in that order whatever ends first; the first error is raised. It must change nothing that others read.

    at_most : run at once, where each needs much memory.
    """
    given = list(items)
    n = min(os.cpu_count() or 1, len(given), at_most or len(given))
    if n < 2:
        return [function(item) for item in given]
    with ThreadPoolExecutor(n) as pool:
        return list(pool.map(function, given))
