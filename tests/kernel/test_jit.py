"""What would be compiled unasked: numba's functions of text, which some kernels by their own text ask for, and kernels for constants."""

import ast
from pathlib import Path

import numpy as np
import pytest

import scan2fea
from scan2fea.kernel.jit import jit

FILES = sorted(path for path in Path(scan2fea.__file__).parent.rglob("*.py") if "import jit" in path.read_text(encoding="utf-8"))


@jit
def entry(values, k):
    return values[k]


@jit
def ends(values):
    at = 0
    first = entry(values, at)
    while at < len(values) - 1:
        at += 1
    return first, entry(values, at), entry(values, -1)


def kernels_of(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and any(ast.unparse(d).startswith("jit") for d in node.decorator_list):
            yield node


def is_number(node):
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    return isinstance(node, ast.Constant) or ast.unparse(node) in ("np.inf", "math.inf")


def is_part(node):
    index = node.slice if isinstance(node, ast.Subscript) else None
    return any(isinstance(part, ast.Slice) for part in (index.elts if isinstance(index, ast.Tuple) else [index]))


def parts_that_take_arrays(kernel):
    """Texts of `name[a:b] = ...` but for numbers, and of `np.cross`, which does the same inside."""
    found = [ast.unparse(node) for node in ast.walk(kernel) if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.cross"]
    for node in ast.walk(kernel):
        if not isinstance(node, ast.Assign | ast.AugAssign):
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            for to, of in zip(target.elts, node.value.elts, strict=True) if both else [(target, node.value)]:
                if is_part(to) and not is_number(of):
                    found.append(ast.unparse(node))
    return found


def test_such_parts_are_found():
    text = "@jit\ndef f(a, b):\n    a[:2], a[2:] = b, 0.0\n    a[:] = -np.inf\n    a[0, 1:] += b\n    return np.cross(a, b)\n"
    (kernel,) = kernels_of(text)
    assert parts_that_take_arrays(kernel) == ["np.cross(a, b)", "a[:2], a[2:] = (b, 0.0)", "a[0, 1:] += b"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_kernels_copy_arrays_by_loops(path):
    found = {kernel.name: parts for kernel in kernels_of(path.read_text(encoding="utf-8")) if (parts := parts_that_take_arrays(kernel))}
    assert found == {}


def test_constants_get_no_kernel_of_their_own():
    assert ends(np.array([3.0, 4.0, 5.0])) == (3.0, 5.0, 5.0)
    assert len(entry.signatures) == 1
