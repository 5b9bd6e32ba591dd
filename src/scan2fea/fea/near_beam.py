"""Free frequencies of straight beams that differ little from one that was solved: Ritz's method on its lowest shapes.

The error of a frequency is of second order in the change of its shape (Rayleigh 1877), and the shapes of hundreds of nearly equal beams need not be
found one by one.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from scan2fea.errors import SolveError
from scan2fea.fea.beam import assemble_beams, beam_element, frequencies, straight
from scan2fea.fea.section_properties import SectionProperties
from scan2fea.types import FloatArray, Material

N_SHAPES = 30  # kept: six rigid and the lowest bending, twisting and axial ones, of which a few are wanted
_TURNS = (3, 4, 6, 10, 11, 13)  # unknowns of an element that are slopes along the beam


class NearBeams:
    """Free straight members near one of section `p` and `length_m`."""

    def __init__(self, p: SectionProperties, material: Material, length_m: float, n_elements: int) -> None:
        matrices = assemble_beams(straight(length_m, p, material, n_elements))
        _, shapes = frequencies(matrices, np.zeros(len(matrices.stiffness), bool), N_SHAPES)
        each = shapes[matrices.dof]  # (elements, 14, shapes)
        self._pairs = np.einsum("eir,ejs->ijrs", each, each, optimize=True).reshape(14 * 14, -1)
        self._n_shapes, self._n_elements = shapes.shape[1], n_elements
        self._length_m, self._material = length_m, material

    def frequencies(self, p: SectionProperties, length_m: float, n_modes: int) -> FloatArray:
        """(n_modes,) Hz, six of them zero. Raises SolveError for a member without length or mass."""
        if not (length_m > 0 and p.area > 0):
            raise SolveError("a beam must have a length and an area")
        # a shape of the same displacements along a longer beam has smaller slopes
        slopes = np.ones(14)
        slopes[list(_TURNS)] = self._length_m / length_m
        element = beam_element(p, self._material, length_m / self._n_elements)
        small = [((slopes[:, None] * a * slopes).ravel() @ self._pairs).reshape(self._n_shapes, -1) for a in element]
        values = scipy.linalg.eigh(*small, eigvals_only=True, subset_by_index=(0, n_modes - 1))
        return np.asarray(np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi))
