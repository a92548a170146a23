"""Integer least squares: Kurs and RTKLIB's LAMBDA (Python package pyrtklib), two nearest vectors of the same problems."""

import math

HEAD = (
    "| ambiguities | Kurs | RTKLIB's LAMBDA, called from Python | the same integers | largest difference of the squared distances |\n"
    "|---|---|---|---|---|"
)
#: Wavelength and noise of single differences: phase, code, m.
WAVELENGTH_M, PHASE_SD_M, CODE_SD_M = 0.19, 0.004, 0.5


def table(options):
    try:
        import numpy as np
        import pyrtklib
    except ImportError as error:
        return f"skipped: {error}", None
    from . import numbers

    search = getattr(pyrtklib, "lambda")

    def theirs(problem):
        arrays, size = filled(pyrtklib, problem), math.isqrt(len(problem))
        status = search(size, 2, *arrays)
        return status, *read(arrays, size)

    random = np.random.default_rng(2)
    rows = [HEAD]
    for size in (6, 12, 24, 48):
        problems = np.array([problem(np, random, size) for _ in range(100 if options.quick else 1000)])
        ours_ns, ours = numbers.kurs("integers", problems, size)
        # Filling RTKLIB's arrays is not its search.
        whole_ns, found = numbers.others(theirs, problems)
        search_ns = whole_ns - numbers.others(lambda p: read(filled(pyrtklib, p), size), problems)[0]
        solved = [(u, z, s) for u, (status, z, s) in zip(ours, found) if status == 0]
        alike = sum(bool(np.array_equal(u[:size], z)) for u, z, _ in solved)
        off = max(np.max(np.abs(u[size:] - s) / np.maximum(1.0, s)) for u, _, s in solved)
        rows.append(
            f"| {size} | {numbers.duration(ours_ns)} | {numbers.duration(search_ns)} | {alike} of {len(problems)} | {off:.0e} |"
        )
    return "\n".join(rows), None


def filled(pyrtklib, problem):
    """RTKLIB's arrays: ambiguities, covariance, both vectors, both squared distances."""
    size = math.isqrt(len(problem))
    arrays = [pyrtklib.Arr1Ddouble(count) for count in (size, size * size, 2 * size, 2)]
    for array, values in zip(arrays, (problem[:size], problem[size:])):
        for k, value in enumerate(values):
            array[k] = value
    return arrays


def read(arrays, size):
    """The nearest vector and both squared distances."""
    return [arrays[2][k] for k in range(size)], [arrays[3][k] for k in range(2)]


def problem(np, random, size):
    """Double-differenced ambiguities of a baseline that code determines, and their covariance: size + size² numbers."""
    sight = random.standard_normal((size + 1, 3))
    sight[:, 2] = np.abs(sight[:, 2])
    sight /= np.linalg.norm(sight, axis=1)[:, None]
    geometry = sight[1:] - sight[0]
    double = np.eye(size) + 1
    place = np.linalg.inv(geometry.T @ np.linalg.inv(double * CODE_SD_M**2) @ geometry)
    covariance = (geometry @ place @ geometry.T + double * PHASE_SD_M**2) / WAVELENGTH_M**2
    float_ = random.integers(-50, 50, size) + np.linalg.cholesky(covariance) @ random.standard_normal(size)
    return np.concatenate([float_, covariance.ravel()])
