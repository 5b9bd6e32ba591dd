import subprocess
import sys

ASKED = """
import os, signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
from scan2fea.kernel.colmap import colmap
colmap()
os.kill(os.getpid(), signal.SIGTERM)
"""


def test_who_handles_the_end_of_a_run_still_does_after_the_import():
    found = subprocess.run([sys.executable, "-c", ASKED], capture_output=True, text=True)
    assert (found.returncode, found.stdout, found.stderr) == (7, "", "")
