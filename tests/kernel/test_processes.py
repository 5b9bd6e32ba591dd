"""A command that works, one that only waits, one that waits too long."""

import subprocess
import sys
import time

import pytest

from scan2fea.kernel import processes
from scan2fea.kernel.processes import run_limited, spent_s


def python(code, seconds):
    return run_limited([sys.executable, "-c", code], seconds)


def test_what_ends_is_told_whole():
    ended = python("import sys; print('a' * 200_000); print('b', file=sys.stderr); sys.exit(3)", 30.0)
    assert (ended.returncode, len(ended.stdout), ended.stderr) == (3, 200_001, "b\n")


def test_work_is_counted_not_waiting(monkeypatch):
    monkeypatch.setattr(processes, "PATIENCE", 60.0)  # a loaded machine works little in a second
    began = spent_s()
    ended = python("import time; time.sleep(1.5); print('done')", 0.8)  # longer on the clock than it may work
    assert ended.stdout == "done\n"
    with pytest.raises(subprocess.TimeoutExpired):
        python("while True: pass", 0.8)
    assert 0.8 <= spent_s() - began < 10.0
    monkeypatch.setattr(processes, "PATIENCE", 1.0)
    clock = time.monotonic()
    with pytest.raises(subprocess.TimeoutExpired):
        python("import time; time.sleep(60)", 0.8)
    assert time.monotonic() - clock < 30.0
