"""Events of the pipeline as progress bars on a terminal and as plain lines elsewhere (standard error)."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, TextIO

from tqdm import tqdm

STAGES_BEFORE_OBJECTS = 5  # read, place, clean, segment, select
STAGES_PER_OBJECT = 9


class Progress:
    """Call it with each event; use it as a context so that bars are closed."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._started = time.perf_counter()
        self._bar: Any = None
        if self._stream.isatty():
            self._bar = tqdm(total=STAGES_BEFORE_OBJECTS, file=self._stream, bar_format="{l_bar}{bar:30}| {elapsed} {postfix}", leave=False)

    def __call__(self, event: Mapping[str, Any]) -> None:
        if self._bar is not None:
            self._draw(event)
        else:
            self._print(event)

    def _draw(self, event: Mapping[str, Any]) -> None:
        what = event["event"]
        if what == "objects":
            self._bar.total = self._bar.n + STAGES_PER_OBJECT * int(event["n"])
            self._bar.refresh()
        elif what == "begin":
            self._bar.set_postfix_str(_where(event) + str(event["name"]), refresh=True)
        elif what == "end":
            self._bar.update(1 if self._bar.n < self._bar.total else 0)
        elif what == "note":
            self._bar.write(f"  {event['text']}", file=self._stream)
        elif what == "verdict":
            self._bar.write(f"  {_where(event)}{event['verdict']}: {event['reason']}", file=self._stream)

    def _print(self, event: Mapping[str, Any]) -> None:
        what, clock = event["event"], f"[{time.perf_counter() - self._started:6.1f} s] "
        if what == "end":
            kept = " (kept)" if event.get("kept") else ""
            line = f"{_where(event)}{event['name']}: {event['n_in']:,} -> {event['n_out']:,} in {event['seconds']:.1f} s{kept}"
        elif what == "note":
            line = str(event["text"])
        elif what == "verdict":
            line = f"{_where(event)}{event['verdict']}: {event['reason']}"
        else:
            return
        print(clock + line, file=self._stream, flush=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.close()


def _where(event: Mapping[str, Any]) -> str:
    return f"object {event['object']}: " if event.get("object") else ""
