"""Integer least squares: Kurs and RTKLIB's LAMBDA (Python package pyrtklib), two nearest vectors of the same problems."""

import contextlib
import math
import os

HEAD = (
    "| ambiguities | Kurs | RTKLIB | RTKLIB gives up | the same integers | largest difference of the squared distances |\n"
    "|---|---|---|---|---|---|"
)
#: Wavelengths of two bands, and noise of single differences: phase, code, m.
WAVELENGTHS_M, PHASE_SD_M, CODE_SD_M = (0.1903, 0.2442), 0.004, 0.5


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
        with silent():
            whole_ns, found = numbers.others(theirs, problems)
        search_ns = whole_ns - numbers.others(lambda p: read(filled(pyrtklib, p), size), problems)[0]
        solved = [(u, z, s) for u, (status, z, s) in zip(ours, found) if status == 0]
        alike = sum(bool(np.array_equal(u[:size], np.rint(z))) for u, z, _ in solved)
        off = max((np.max(np.abs(u[size:] - s) / np.maximum(1.0, s)) for u, _, s in solved), default=np.nan)
        rows.append(
            f"| {size} | {numbers.duration(ours_ns)} | {numbers.duration(search_ns)} | {len(problems) - len(solved)} "
            f"| {alike} of {len(solved)} | {off:.0e} |"
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


@contextlib.contextmanager
def silent():
    """Standard error of C code goes nowhere: RTKLIB tells every search that it gives up."""
    kept = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def problem(np, random, size):
    """Double-differenced ambiguities of a baseline that code determines, two bands of size / 2 pairs of satellites, and their
    covariance: size + size² numbers."""
    count = size // 2
    sight = random.standard_normal((count + 1, 3))
    sight[:, 2] = np.abs(sight[:, 2])
    sight /= np.linalg.norm(sight, axis=1)[:, None]
    geometry = sight[1:] - sight[0]
    double = np.eye(count) + 1
    # Code on either band.
    place = np.linalg.inv(2 * geometry.T @ np.linalg.inv(double * CODE_SD_M**2) @ geometry)
    cycles = np.vstack([geometry / wavelength_m for wavelength_m in WAVELENGTHS_M])
    phases = np.kron(np.diag([PHASE_SD_M**2 / wavelength_m**2 for wavelength_m in WAVELENGTHS_M]), double)
    covariance = cycles @ place @ cycles.T + phases
    float_ = random.integers(-50, 50, size) + np.linalg.cholesky(covariance) @ random.standard_normal(size)
    return np.concatenate([float_, covariance.ravel()])
