"""The console script `kurs`: the program, inside this process."""

import os
import signal
import sys

from kurs import _native


def main() -> None:
    """Runs `kurs` with the arguments of the command line and ends with its exit status."""
    # The program has its own way with Ctrl-C, and ends quietly where `kurs … | head` has seen enough.
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    status = _native.run(["kurs", *sys.argv[1:]])
    sys.stdout.flush()
    os._exit(status)
