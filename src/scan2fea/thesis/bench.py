"""What the experiments share: options, and intermediate results that are made once and kept on disk."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from scan2fea.errors import Scan2FeaError
from scan2fea.io.artifacts import load, save
from scan2fea.pipeline.record import key_of

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class ThesisOptions:
    """quick : smaller inputs, each told where it is used.   clock_s : the thesis's limit of ODT, perturbation and exudation instead of iterations;
    the results then depend on the machine.   real : a Velodyne HDL-32E capture (.pcap) for the acquisition part, or None.
    """

    quick: bool = False
    clock_s: float | None = None
    real: Path | None = None
    seed: int = 0

    def tree(self) -> dict[str, Any]:
        """What results depend on."""
        real = None if self.real is None else hashlib.sha256(self.real.read_bytes()).hexdigest()
        return {"quick": self.quick, "clock_s": self.clock_s, "real": real, "seed": self.seed}


@dataclass(frozen=True, kw_only=True)
class Bench:
    """folder : for what is kept.   options : of this run."""

    folder: Path
    options: ThesisOptions
    _memory: dict[str, Any] = field(default_factory=dict)
    _failed: dict[str, Scan2FeaError] = field(default_factory=dict)

    def kept(self, name: str, make: Callable[[], T], *depends: Any) -> T:
        """`make()` once per name and what it depends on: from memory, else from disk, else made. A failure is told again without another try."""
        key = key_of("thesis", name, self.options.tree(), *depends)
        if key in self._failed:
            raise self._failed[key]
        if key not in self._memory:
            path = self.folder / f"{name.replace(' ', '_')}-{key[:20]}.npz"
            found: Any = None
            if path.exists():
                with contextlib.suppress(Scan2FeaError):  # cut short by an interruption: made again
                    found = load(path)
            if found is None:
                try:
                    found = make()
                except Scan2FeaError as error:
                    self._failed[key] = error
                    raise
                self.folder.mkdir(parents=True, exist_ok=True)
                save(found, path)
            self._memory[key] = found
        return self._memory[key]  # type: ignore[no-any-return]
