"""Rows of relative.csv against the truth of a simulation: are the relative angles as good as their covariance says."""

import csv
import math
from dataclasses import dataclass, field
from datetime import datetime

import numpy

ANGLES = ("heading", "pitch", "roll")
COVARIANCES = ((0, 1, "cov_hp_deg2"), (0, 2, "cov_hr_deg2"), (1, 2, "cov_pr_deg2"))
#: Both attitudes of a row are of one time if they are no older than this, s.
ONE_TIME_S = 1e-3
#: Of a normal distribution, beyond which one of a thousand is.
QUANTILE_999 = 3.29


def attitudes(file):
    """The true heading, pitch, roll of a body by its second of week, degrees."""
    with open(file) as lines:
        return {round(float(row["tow_s"]), 2): [float(row[f"{name}_deg"]) for name in ANGLES] for row in csv.DictReader(lines)}


def second_of_week(time_gpst):
    """Of a time as rows have it; clocks of receivers are off by less than the hundredth to which it is rounded."""
    return round((datetime.fromisoformat(time_gpst) - datetime(1980, 1, 6)).total_seconds() % 604_800, 2)


def seen_from(own_deg, other_deg):
    """Heading, pitch, roll of the other body in the axes of this one, degrees."""
    m = level_from_body(own_deg).T @ level_from_body(other_deg)
    return [math.degrees(a) for a in (math.atan2(m[1, 0], m[0, 0]), -math.asin(m[2, 0]), math.atan2(m[2, 1], m[2, 2]))]


def level_from_body(angles_deg):
    """North, east, down from forward, right, down: heading, then pitch, then roll."""
    (sh, ch), (sp, cp), (sr, cr) = ((math.sin(a), math.cos(a)) for a in map(math.radians, angles_deg))
    heading = numpy.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])
    pitch = numpy.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll = numpy.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return heading @ pitch @ roll


@dataclass
class Score:
    """Fixed rows of one kind."""

    rows: int = 0
    #: Angles that these rows print, and the sum of their normalised squares.
    angles: int = 0
    squares: float = 0.0
    worst_heading_sd: float = 0.0

    def add(self, row, truth_deg):
        """Counts a row by the angles that it prints; the others nobody sees."""
        seen = [k for k, name in enumerate(ANGLES) if row[f"{name}_deg"]]
        error = numpy.array([(float(row[f"{ANGLES[k]}_deg"]) - truth_deg[k] + 180) % 360 - 180 for k in seen])
        covariance = numpy.diag([float(row[f"{name}_sd_deg"] or 0) ** 2 for name in ANGLES])
        for i, j, name in COVARIANCES:
            covariance[i, j] = covariance[j, i] = float(row[name] or 0)
        self.rows += 1
        self.angles += len(seen)
        self.squares += error @ numpy.linalg.solve(covariance[numpy.ix_(seen, seen)], error)
        if 0 in seen:
            self.worst_heading_sd = max(self.worst_heading_sd, abs(error[0]) / covariance[0, 0] ** 0.5)

    @property
    def nees(self):
        """Mean normalised square of an angle: 1 is right."""
        return self.squares / self.angles if self.angles else float("nan")

    @property
    def band(self):
        """How far from 1 it may be by chance, one of a thousand times beyond."""
        return QUANTILE_999 * (2 / self.angles) ** 0.5 if self.angles else float("nan")


@dataclass
class View:
    """What one body saw of another."""

    statuses: dict = field(default_factory=lambda: {"fixed": 0, "float": 0, "lost": 0})
    of_one_time: Score = field(default_factory=Score)
    #: One of the attitudes is older or newer; its rates brought it to the time of the other.
    by_rates: Score = field(default_factory=Score)


def view(files, own, other):
    """Rows of one body about the other, whose true attitudes are these."""
    found = View()
    for file in files:
        with open(file) as lines:
            for row in csv.DictReader(lines):
                found.statuses[row["status"]] += 1
                if row["status"] == "fixed":
                    age_s = max(abs(float(row["own_age_s"])), abs(float(row["peer_age_s"])))
                    score = found.of_one_time if age_s <= ONE_TIME_S else found.by_rates
                    tow_s = second_of_week(row["time_gpst"])
                    score.add(row, seen_from(own[tow_s], other[tow_s]))
    return found
