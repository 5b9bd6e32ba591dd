"""Numba with types that mypy can follow; compiled code is cached on disk.

Kernels copy an array into a part of another by a loop, not by `rows[k] = row`: for the message that the shapes differ numba compiles its functions
of text, five seconds of processor time in every process that compiles, and puts them into every such kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile for one thread, without fast-math: the same bytes on every run."""
    return _kernel(function)


def jit_ieee(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit`, but a division by zero gives inf or nan as in numpy's arrays, where plain kernels raise ZeroDivisionError; its test is saved."""
    return _kernel(function, error_model="numpy")


def jit_inline(function: Callable[P, R]) -> Callable[P, R]:
    """As `jit_ieee`, for the small parts of one hot loop: written into it, so that its arrays are not counted in and out at every call."""
    return _kernel(function, error_model="numpy", inline="always")


def _kernel(function: Callable[P, R], **more: str) -> Callable[P, R]:
    """Without what takes long to compile and nobody asks for: the wrapper for calls from C, and a kernel of its own for each whole number that
    another kernel passes as a constant, or that a variable of it holds at first.
    """
    compiled = numba.njit(cache=True, nogil=True, no_cfunc_wrapper=True, **more)(function)
    of_types = compiled.get_call_template

    def of_plain_types(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        return of_types(tuple(_plain(kind) for kind in args), {name: _plain(kind) for name, kind in kws.items()})

    compiled.get_call_template = of_plain_types
    return cast("Callable[P, R]", compiled)


def _plain(kind: Any) -> Any:
    return numba.types.unliteral(kind) if isinstance(kind, numba.types.IntegerLiteral) else kind
