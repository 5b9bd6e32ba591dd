"""An inertial log with long gaps: what a filter that must know every moment can use of it."""

from __future__ import annotations

import numpy as np

from scan2fea.types import InertialLog

BRIDGED_S = 1.0  # over a shorter gap the filter goes on with a wide deviation


def longest_piece(log: InertialLog) -> tuple[InertialLog, tuple[str, ...]]:
    """The longest piece without a gap of more than a second, and a note where something was left out."""
    steps = np.diff(log.time_s)
    cut = np.flatnonzero((steps > BRIDGED_S) & log.is_gap[1:]) + 1
    if not len(cut):
        return log, ()
    edges = np.concatenate([[0], cut, [len(log)]])
    seconds = log.time_s[edges[1:] - 1] - log.time_s[edges[:-1]]
    k = int(np.argmax(seconds))
    rows = slice(int(edges[k]), int(edges[k + 1]))
    is_gap = log.is_gap[rows].copy()
    is_gap[0] = False
    magnetic = None if log.magnetic is None else log.magnetic[rows]
    piece = InertialLog(time_s=log.time_s[rows], rate=log.rate[rows], force=log.force[rows], is_gap=is_gap, magnetic=magnetic)
    says = (
        f"the inertial log has {len(cut)} gaps of more than {BRIDGED_S:g} s: the longest piece was used, {piece.time_s[0]:.3f} to "
        f"{piece.time_s[-1]:.3f} s of {log.time_s[0]:.3f} to {log.time_s[-1]:.3f} s"
    )
    return piece, (says,)
