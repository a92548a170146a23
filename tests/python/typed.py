"""What a user's type checker sees."""

import kurs
import numpy as np
from numpy.typing import NDArray


def heading(body: NDArray[np.float64], local: NDArray[np.float64]) -> float:
    found = kurs.attitude.wahba(body, local)
    heading_deg = found.heading_deg
    assert isinstance(heading_deg, float)
    return heading_deg


def headings(config: str) -> NDArray[np.float64]:
    solution: kurs.Solution = kurs.solve(config, bands=["G1"])
    return solution.attitude["heading_deg"]


def all_of(a: NDArray[np.float64], Q: NDArray[np.float64]) -> NDArray[np.int64]:
    return kurs.ambiguity.lambda_(a, Q).integers
