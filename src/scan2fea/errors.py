"""Everything that scan2fea raises on purpose.

::

    Scan2FeaError
    ├── UsageError            a wrong option, key or combination           exit 2
    ├── InputError            a file or its content cannot be used         exit 3
    │   ├── FormatError       not what its name or header says
    │   └── EmptyScanError    readable, but no usable point in it
    ├── StageError            one object cannot go on: the run does        exit 4 if it is the last
    │   ├── SegmentationError
    │   ├── EstimationError
    │   ├── ReconstructionError
    │   ├── RepairError
    │   ├── MeshingError
    │   ├── CadError
    │   ├── SolveError
    │   └── FusionError       logs of motion sensors that contradict each other
    └── InternalError         a promise of ours was broken                 exit 5

A message names the file or the value, the limit, and what to do about it. The library raises; only the CLI prints.
"""

from __future__ import annotations


class Scan2FeaError(Exception):
    """Root of the tree; `exit_code` is what the CLI ends with."""

    exit_code = 5


class UsageError(Scan2FeaError):
    exit_code = 2


class InputError(Scan2FeaError):
    exit_code = 3


class FormatError(InputError):
    pass


class EmptyScanError(InputError):
    pass


class StageError(Scan2FeaError):
    exit_code = 4


class SegmentationError(StageError):
    pass


class EstimationError(StageError):
    pass


class ReconstructionError(StageError):
    pass


class RepairError(StageError):
    pass


class CrossingError(RepairError):
    """The surface still crosses or touches itself after repair: a mesher of solids that works with such surfaces may find one."""


class MeshingError(StageError):
    pass


class CadError(StageError):
    pass


class SolveError(StageError):
    pass


class FusionError(StageError):
    pass


class InternalError(Scan2FeaError):
    exit_code = 5


def require(condition: object, error: type[Scan2FeaError], message: str) -> None:
    """Raise `error(message)` unless `condition` holds."""
    if not condition:
        raise error(message)
