"""`kurs live` and rtkrcv on the same streams: bench/live.py rtkrcv."""

import os
import shutil
import subprocess
import sys


def table(options):
    if not shutil.which("rtkrcv"):
        return "skipped: no rtkrcv (Debian's package rtklib)", None
    seconds = 15 if options.quick else 180
    command = [sys.executable, "bench/live.py", "rtkrcv", "--seconds", str(seconds)]
    environment = {**os.environ, "KURS": os.path.abspath(options.kurs)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    return (done.stdout if done.returncode == 0 else f"failed: {done.stderr.strip()[-300:]}").strip(), None
