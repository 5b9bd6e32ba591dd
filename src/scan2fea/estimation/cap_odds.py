"""Bar or tube, by how many points lie at the ends of the core: a bar's caps put points there, a tube's rings do not.

What was scanned of a bar's caps is not known: nothing, mostly a third or more of what caps as dense as the sides would hold, seldom less. Averaged
over that (and not at its best, where a bar always wins by chance), a few points more than strays are no cap that should have held a hundred.
"""

from __future__ import annotations

import math

import numpy as np

_UNSEEN, _THIN = 0.3, 0.1  # beliefs that the caps of a bar were not scanned, and that they hold fewer points than
_CAP = 1 / 3  # of those that caps as dense as the sides would
_MOST = 50.0  # log odds are capped: nothing is that certain
_STEPS = 2000


def bar_log_odds(n_core: int, n_elsewhere: float, n_cap: float) -> float:
    """Log odds of a bar against a section with walls. n_core : points at the ends of the core.   n_elsewhere : those expected there anyway, > 0.

    n_cap : those that caps as dense as the sides would add. Counts are Poisson's.
    """
    if n_cap <= 0:
        return 0.0
    added = np.geomspace(1e-6 * n_cap, n_cap, _STEPS)
    belief = np.where(added < _CAP * n_cap, _THIN / _CAP, (1 - _UNSEEN - _THIN) / (1 - _CAP)) / n_cap
    level = n_core * np.log1p(added / n_elsewhere) - added  # log likelihood over that without a cap
    top = float(level.max())
    scanned = math.log(float(np.trapezoid(belief * np.exp(level - top), added))) + top
    return min(float(np.logaddexp(math.log(_UNSEEN), scanned)), _MOST)
