"""How many of the points lie on each face: the shares of a mixture of known densities by expectation and maximisation."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray


@jit_ieee
def likeliest_share(density: FloatArray, begun: FloatArray, strays: float, n_rounds: int, still: float) -> FloatArray:
    """(f,) shares of most likelihood, from `begun`, after so many rounds or one that moves none by `still`.

    density : (n, f) of each point if it were of that face.   strays : density of what is of none, above zero.
    """
    n, n_faces = density.shape
    share, part = begun.copy(), np.empty(n_faces)
    for _ in range(n_rounds):
        new, every = np.zeros(n_faces), 0.0
        for i in range(n):
            total = strays
            for k in range(n_faces):
                part[k] = density[i, k] * share[k]
                total += part[k]
            for k in range(n_faces):
                new[k] += part[k] / total
        for k in range(n_faces):
            every += new[k]
        moved = 0.0
        for k in range(n_faces):
            new[k] /= max(every, 1e-300)
            moved = max(moved, abs(new[k] - share[k]))
        share = new
        if moved < still:
            break
    return share
