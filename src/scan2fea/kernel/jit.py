"""Numba with types that mypy can follow; compiled code is cached on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile for one thread, without fast-math: the same bytes on every run."""
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True)(function))


def jit_ieee(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, but a division by zero gives inf or nan as in numpy's arrays, where plain kernels raise ZeroDivisionError; its test is saved."""
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def jit_inline(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit_ieee`, for the small parts of one hot loop: written into it, so that its arrays are not counted in and out at every call."""
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")(function))
