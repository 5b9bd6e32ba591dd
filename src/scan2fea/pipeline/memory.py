"""How much memory a stage needed: a thread that looks at the resident size of this process and its children."""

from __future__ import annotations

import threading
from types import TracebackType

import psutil

from scan2fea.units import BYTES_PER_MIB

PERIOD_S = 0.05


class PeakMemory:
    """`with PeakMemory() as peak: ...` then `peak.mb`. Works wherever psutil does; costs about 0.1 % of one core."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.mb = 0.0

    def _look(self) -> None:
        total = 0
        try:
            family = [self._process, *self._process.children(recursive=True)]
        except psutil.Error:
            family = [self._process]
        for process in family:
            try:
                total += process.memory_info().rss
            except psutil.Error:
                continue  # it ended between the two calls
        self.mb = max(self.mb, total / BYTES_PER_MIB)

    def _watch(self) -> None:
        while not self._stop.wait(PERIOD_S):
            self._look()

    def __enter__(self) -> PeakMemory:
        self._look()
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._look()
        self._stop.set()
        self._thread.join()
