"""What is a wrong fix, for recordings and simulated sessions, for Kurs and for others: here and nowhere else in bench."""

import statistics
from dataclasses import dataclass, field

#: An error that no standard deviation excuses, m.
ALWAYS_WRONG_M = 0.15
#: Errors below are no mistakes: the places are known no better, m.
FLOOR_M = 0.05


def is_wrong(off_m, sd_m, floor_m=FLOOR_M):
    """Whether a baseline with these errors and standard deviations (east, north, up) has wrong integers."""
    return max(map(abs, off_m)) > ALWAYS_WRONG_M or any(abs(o) > max(floor_m, 5 * s) for o, s in zip(off_m, sd_m))


def is_beyond(off_m, sd_m):
    """Whether a component is off by more than three of its standard deviations."""
    return any(abs(o) > 3 * s for o, s in zip(off_m, sd_m))


@dataclass
class Score:
    """The fixes of one run against the truth."""

    fixed: int = 0
    wrong: int = 0
    #: Fixes with a component beyond three of its standard deviations, wrong ones included.
    beyond: int = 0
    #: Errors over standard deviations of the right fixes' components.
    units: list = field(default_factory=list)
    #: Errors of the right fixes, by their times: east, north, up, m.
    errors_m: dict = field(default_factory=dict)

    def add(self, off_m, sd_m, floor_m, at=None):
        """Counts a fix; whether it is wrong."""
        wrong = is_wrong(off_m, sd_m, floor_m)
        self.fixed += 1
        self.wrong += wrong
        self.beyond += is_beyond(off_m, sd_m)
        if not wrong:
            self.units += [o / s for o, s in zip(off_m, sd_m)]
            self.errors_m[self.fixed if at is None else at] = off_m
        return wrong

    @property
    def right(self):
        return self.fixed - self.wrong

    @property
    def mean_square(self):
        """Mean normalised square of a component: 1 where the standard deviations are honest."""
        return statistics.mean(u * u for u in self.units) if self.units else float("nan")

    @property
    def rms_m(self):
        """Of the whole error of a right fix."""
        return statistics.mean(sum(o * o for o in off_m) for off_m in self.errors_m.values()) ** 0.5

    def scatter_m(self, times):
        """The same of the right fixes of these times, about the mean of their errors: what is taken for the truth has no part in it."""
        components = zip(*(self.errors_m[at] for at in times))
        return sum(statistics.pvariance(component) for component in components) ** 0.5
