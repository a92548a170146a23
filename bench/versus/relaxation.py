"""The relaxed choice of baselines: Kurs, Clarabel and SCS on the same programme (problem 2 of paper 002, homogenised)."""

import itertools

HEAD = (
    "| antennas | solver | least condition number, mean | farthest from Clarabel's | time of a problem |\n"
    "|---|---|---|---|---|"
)
ROOT_2 = 2**0.5


def table(options):
    try:
        import clarabel
        import numpy as np
        import scs
        from scipy import sparse
    except ImportError as error:
        return f"skipped: {error}", None
    from . import numbers

    def by_clarabel(places):
        c, equal, below, matrices = programme(np, places, "upper")
        a = sparse.csc_matrix(np.vstack([equal[0], below[0], matrices[0]]))
        b = np.concatenate([equal[1], below[1], matrices[1]])
        cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(len(below[1])), *[clarabel.PSDTriangleConeT(3)] * 2]
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        zero = sparse.csc_matrix((len(c), len(c)))
        return clarabel.DefaultSolver(zero, c, a, b, cones, settings).solve().obj_val

    def by_scs(places):
        c, equal, below, matrices = programme(np, places, "lower")
        data = {
            "A": sparse.csc_matrix(np.vstack([equal[0], below[0], matrices[0]])),
            "b": np.concatenate([equal[1], below[1], matrices[1]]),
            "c": c,
        }
        cone = {"z": 1, "l": len(below[1]), "s": [3, 3]}
        return scs.SCS(data, cone, verbose=False, eps_abs=1e-7, eps_rel=1e-7).solve()["info"]["pobj"]

    random = np.random.default_rng(3)
    rows = [HEAD]
    for antennas in (4, 6, 8):
        places = random.uniform(-0.5, 0.5, (10 if options.quick else 50, antennas, 3))
        ours_ns, bounds = numbers.kurs("relaxation", places.reshape(len(places), -1), antennas)
        clarabel_ns, wanted = numbers.others(by_clarabel, places)
        scs_ns, rough = numbers.others(by_scs, places)
        for name, values, ns in (("Kurs", bounds[:, 0], ours_ns), ("Clarabel", wanted, clarabel_ns), ("SCS", rough, scs_ns)):
            off = np.max(np.abs(np.array(values) / np.array(wanted) - 1))
            rows.append(f"| {antennas} | {name} | {np.mean(values):.4f} | {off:.0e} | {numbers.duration(ns)} |")
    return "\n".join(rows), None


def programme(np, places, half):
    """min k with I ⪯ Σ z l lᵀ ⪯ k I, z = τ s: c, then A x + slack = b for the zero, the nonnegative and the two matrix cones.

    Unknowns: z of every pair, τ, k. Matrices as columns of their `half` triangle, off the diagonal times √2.
    """
    antennas = len(places)
    pairs = list(itertools.combinations(range(antennas), 2))
    count = len(pairs)
    lines = np.array([places[j] - places[i] for i, j in pairs])
    grams = np.einsum("ki,kj->kij", lines, lines) / np.mean(np.sum(lines**2, axis=1))
    c = np.zeros(count + 2)
    c[-1] = 1.0
    equal = np.zeros((1, count + 2))
    equal[0, :count], equal[0, count] = 1.0, -(antennas - 1)
    below = [np.hstack([-np.eye(count), np.zeros((count, 2))])]
    below.append(np.hstack([np.eye(count), -np.ones((count, 1)), np.zeros((count, 1))]))
    for size in range(2, antennas):
        for members in itertools.combinations(range(antennas), size):
            row = np.zeros((1, count + 2))
            row[0, :count] = [i in members and j in members for i, j in pairs]
            row[0, count] = -(size - 1)
            below.append(row)
    below = np.vstack(below)

    def triangle(matrix):
        order = [(i, j) for j in range(3) for i in (range(j + 1) if half == "upper" else range(j, 3))]
        return np.array([matrix[i, j] * (1.0 if i == j else ROOT_2) for i, j in order])

    columns = np.column_stack([triangle(g) for g in grams])
    one = triangle(np.eye(3))
    zero = np.zeros((6, 1))
    matrices = np.vstack([np.hstack([-columns, zero, zero]), np.hstack([columns, zero, -one[:, None]])])
    return c, (equal, np.zeros(1)), (below, np.zeros(len(below))), (matrices, np.concatenate([-one, np.zeros(6)]))
