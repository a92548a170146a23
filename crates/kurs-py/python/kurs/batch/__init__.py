"""Many sessions, and many runs of one scenario, on any executor: the result does not depend on which."""

from kurs.batch._manifest import run
from kurs.batch._monte_carlo import MonteCarlo, monte_carlo, seed_of
from kurs.batch._ray import RayExecutor

__all__ = ["MonteCarlo", "RayExecutor", "monte_carlo", "run", "seed_of"]
