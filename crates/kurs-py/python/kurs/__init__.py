"""Heading, pitch and roll from the raw signals of several GNSS antennas.

Names, units and columns are those of the command line. Numbers are numpy arrays; a missing one is NaN. Functions
of `attitude` and `ambiguity` take one problem, or N of them with a leading dimension, which run in parallel.

Frames: body axes are forward, right, down; local axes north, east, down; `local_from_body` turns components in
body axes into components in local axes. Quaternions are scalar first.
"""

from kurs import ambiguity, attitude, batch, calibration, fusion, point, selection, trajectory
from kurs._commands import Solution, inspect, plan, simulate, solve
from kurs._engine import Engine
from kurs._files import Navigation, Observations, read_nav, read_obs
from kurs._native import Error, InputError, NoSolution, UsageError
from kurs._native import version as _version
from kurs._table import Table

__version__: str = _version()

__all__ = [
    "Engine",
    "Error",
    "InputError",
    "Navigation",
    "NoSolution",
    "Observations",
    "Solution",
    "Table",
    "UsageError",
    "ambiguity",
    "attitude",
    "batch",
    "calibration",
    "fusion",
    "inspect",
    "plan",
    "point",
    "read_nav",
    "read_obs",
    "selection",
    "simulate",
    "solve",
    "trajectory",
]
