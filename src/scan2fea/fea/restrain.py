"""What is held: by node and direction; whether that is enough; and the body that nothing holds, balanced by its own inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FEModel, FloatArray, IntArray

_LOOSE = 1e-6  # singular value of the held unknowns under rigid motions, relative to the largest, below which the body is not held


def rigid_fields(nodes: FloatArray) -> FloatArray:
    """(n, 3, 6) translations along and rotations about x, y, z through the mean of the nodes; lengths in units of the size."""
    x = nodes - nodes.mean(axis=0)
    x = x / np.abs(x).max()
    out = np.zeros((len(x), 3, 6))
    for axis in range(3):
        out[:, axis, axis] = 1.0
        out[:, :, 3 + axis] = np.cross(np.eye(3)[axis], x)
    return out


def held_unknowns(model: FEModel) -> BoolArray:
    """(n, 3) bool. Raises SolveError for an empty set and where a rigid motion is left, naming it."""
    held = np.zeros((len(model.mesh.nodes), 3), bool)
    for name, directions in model.supports.items():
        nodes = model.node_sets.get(name, np.zeros(0, np.int64))
        require(len(nodes), SolveError, f"the support {name} holds nothing: the set is empty")
        for axis in range(3):
            if "xyz"[axis] in directions:
                held[nodes, axis] = True
    loose = free_motions(np.asarray(model.mesh.nodes), held)
    held_by = ", ".join(f"{name} in {directions}" for name, directions in model.supports.items())
    require(not loose, SolveError, f"the part is not held against {' and '.join(loose)}: only {held_by} is; hold another face or direction")
    return held


def free_motions(nodes: FloatArray, held: BoolArray) -> tuple[str, ...]:
    """Rigid motions that the held unknowns (n, 3) allow, in words: a motion with any turning in it is one about a line of its direction."""
    rigid = np.linalg.qr(rigid_fields(nodes)[held], mode="r")  # the same motions and sizes in six rows at most
    _, size, motion = np.linalg.svd(rigid, full_matrices=True) if len(rigid) >= 6 else np.linalg.svd(np.vstack([rigid, np.zeros((6, 6))]))
    size = np.concatenate([size, np.zeros(6 - len(size))])
    loose = motion[size <= _LOOSE * max(float(size[0]), 1e-300)]
    # of several the plain translations first, so that each is named once
    turning = np.linalg.svd(loose[:, 3:], full_matrices=True)
    strength = np.concatenate([turning[1], np.zeros(len(loose) - len(turning[1]))])
    rows = turning[0].T @ loose if len(loose) else loose
    return tuple(_named(row, bool(s > _LOOSE)) for row, s in zip(rows, strength, strict=True))


def _named(motion: FloatArray, turns: bool) -> str:
    part = motion[3:] if turns else motion[:3]
    return f"{'turning about' if turns else 'moving along'} {'xyz'[int(np.abs(part).argmax())]}"


@jit
def _cleared(indptr: IntArray, indices: IntArray, held: BoolArray, stiffness: FloatArray) -> None:
    """Rows and columns of held unknowns to zero, their diagonal kept."""
    for i in range(len(indptr) - 1):
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            for r in range(3):
                for c in range(3):
                    if (held[i, r] or held[j, c]) and not (i == j and r == c):
                        stiffness[k, r, c] = 0.0


def restrained(system: System, held: BoolArray) -> System:
    """The system with single unknowns of nodes held; where all of a node's are, nothing needs to change: such nodes are left out by the solver."""
    partly = held & ~np.asarray(held.all(axis=1))[:, None]
    if not partly.any():
        return system
    stiffness = np.array(system.stiffness)
    _cleared(np.array(system.indptr), np.array(system.indices), partly, stiffness)
    return replace(system, stiffness=stiffness)


def three_points(nodes: FloatArray) -> BoolArray:
    """(n, 3) six unknowns at three far-apart nodes that hold a body and strain nothing where the loads balance."""
    first = int(np.argmax(np.linalg.norm(nodes - nodes.mean(axis=0), axis=1)))
    second = int(np.argmax(np.linalg.norm(nodes - nodes[first], axis=1)))
    along = (nodes[second] - nodes[first]) / np.linalg.norm(nodes[second] - nodes[first])
    away = nodes - nodes[first]
    third = int(np.argmax(np.linalg.norm(away - (away @ along)[:, None] * along, axis=1)))
    held = np.zeros((len(nodes), 3), bool)
    held[first] = True
    # the axis nearest to the line stays free at the second point; at the third the one that is most across their plane is held
    axis = int(np.argmax(np.abs(along)))
    held[second, [k for k in range(3) if k != axis]] = True
    normal = np.cross(along, nodes[third] - nodes[first])
    held[third, int(np.argmax(np.abs(normal)))] = True
    return held


def inertia_balanced(nodes: FloatArray, system: System, force: FloatArray) -> FloatArray:
    """The forces (n, 3) less what accelerates the body as a whole: f - M R (R' M R)^-1 R' f (inertia relief)."""
    rigid = rigid_fields(nodes)
    carried = (system.mass_matrix() @ rigid.reshape(len(nodes), -1)).reshape(rigid.shape)
    small = np.einsum("ncr,ncs->rs", rigid, carried)
    share = np.linalg.solve(small, np.einsum("ncr,nc->r", rigid, force))
    return np.asarray(force - carried @ share)
