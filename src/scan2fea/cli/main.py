"""`scan2fea COMMAND ...`: parses, runs, and turns every error into one line and an exit code.

Exit codes: 0 done, 2 usage, 3 bad input, 4 nothing converted or check not passed, 5 a fault of ours, 130 interrupted.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scan2fea.cli.parser import parser
from scan2fea.errors import Scan2FeaError

EXIT_FAULT, EXIT_INTERRUPTED = 5, 130
# of commands that keep what they made: how to go on
GOES_ON = {
    "run": ": `scan2fea run ... --resume` with the same OUT goes on from here",
    "thesis": ": the same command with the same OUT goes on from here",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Never raises but for SystemExit of argparse (2, or 0 for --help)."""
    given = parser().parse_args(arguments)
    command: Any = importlib.import_module(f"scan2fea.cli.{given.command}_command")
    try:
        return int(command.execute(given))
    except Scan2FeaError as error:
        _say(str(error))
        return error.exit_code
    except KeyboardInterrupt:
        return _interrupted(given.command)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        _say("out of memory: give fewer points (filtering.voxel_m) or set input.memory_gib to what this machine has")
        return EXIT_FAULT
    except Exception as error:  # noqa: BLE001 - the last line of defence: a fault of ours is told, not shown as a traceback
        if _by_interrupt(error):
            return _interrupted(given.command)
        _say(f"internal fault ({type(error).__name__}: {error}); please report it with {_trace()}")
        return EXIT_FAULT


def _by_interrupt(error: BaseException) -> bool:
    """Compiled code turns an interrupt into a SystemError, and while it is loaded that into another."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    return cause is not None


def _interrupted(command: str) -> int:
    _say(f"interrupted{GOES_ON.get(command, '')}")
    return EXIT_INTERRUPTED


def _trace() -> str:
    import tempfile
    import traceback

    handle, name = tempfile.mkstemp(prefix="scan2fea-fault-", suffix=".txt")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        traceback.print_exc(file=file)
    return str(Path(name))


def _say(text: str) -> None:
    one_line = " ".join(text.split())
    print(f"scan2fea: {one_line}", file=sys.stderr)


def entry() -> None:
    """Console script. Asked to end (SIGTERM) it ends as at Ctrl-C, with its workers."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())
