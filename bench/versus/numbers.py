"""Problems of numbers: the example `versus` of the library solves ours."""

import subprocess
import time

import numpy as np

EXAMPLE = "target/release/examples/versus"


def kurs(kind, problems, size=None):
    """Mean processor time of a problem, ns, and the results; `problems` has one in each row."""
    text = "\n".join(" ".join(map(repr, row)) for row in problems.tolist())
    command = [EXAMPLE, kind, *([] if size is None else [str(size)])]
    lines = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout.splitlines()
    return float(lines[0]), np.array([[float(word) for word in line.split()] for line in lines[1:]])


def others(solve, problems):
    """The same of a function of Python that solves one problem."""
    started = time.process_time()
    found = [solve(problem) for problem in problems]
    return (time.process_time() - started) * 1e9 / len(found), found


def duration(ns):
    return f"{ns:.0f} ns" if ns < 1e3 else f"{ns / 1e3:.1f} µs" if ns < 1e6 else f"{ns / 1e6:.1f} ms"
