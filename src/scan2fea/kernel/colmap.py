"""The wheel `pycolmap`, as photographs and screened Poisson use it."""

from __future__ import annotations

import signal
import threading
from typing import Any


def colmap() -> Any:
    """The module, silent. On import it takes SIGTERM for itself and prints a C stack: who was asked to end before is asked again."""
    import pycolmap

    pycolmap.logging.minloglevel = 3
    if threading.current_thread() is threading.main_thread():  # nobody else may say what signals do
        signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM) or signal.SIG_DFL)
    return pycolmap
