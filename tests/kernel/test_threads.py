"""Order, errors, and that it does run side by side."""

import threading

import numpy as np
import pytest

from scan2fea.kernel import threads
from scan2fea.kernel.threads import in_threads


def test_results_come_in_order_and_the_first_error_is_raised(monkeypatch):
    monkeypatch.setattr(threads.os, "cpu_count", lambda: 4)
    meet = threading.Barrier(3, timeout=30)  # passes only if three run at once

    def work(k):
        meet.wait()
        return int(np.sort(np.random.default_rng(k).random(1000)).argmax()) + k

    assert in_threads(work, range(3)) == [999, 1000, 1001]
    assert in_threads(lambda k: k, []) == []
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda k: 1 / k, [1, 0, 2])
