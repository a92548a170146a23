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
    #: Errors of the right fixes: east, north, up, m.
    errors_m: list = field(default_factory=list)

    def add(self, off_m, sd_m, floor_m):
        """Counts a fix; whether it is wrong."""
        wrong = is_wrong(off_m, sd_m, floor_m)
        self.fixed += 1
        self.wrong += wrong
        self.beyond += is_beyond(off_m, sd_m)
        if not wrong:
            self.units += [o / s for o, s in zip(off_m, sd_m)]
            self.errors_m.append(tuple(off_m))
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
        return sum(mean**2 + sd**2 for mean, sd in self.of_components()) ** 0.5

    @property
    def scatter_m(self):
        """The same about the mean of these errors: the place that is taken for the truth has no part in it."""
        return sum(sd**2 for _, sd in self.of_components()) ** 0.5

    def of_components(self):
        """Mean and standard deviation of the errors of the right fixes, m."""
        return [(statistics.fmean(c), statistics.pstdev(c)) for c in zip(*self.errors_m)]
