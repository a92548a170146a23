"""Wahba's problem: Kurs, scipy's Rotation.align_vectors, and QUEST (Shuster and Oh 1981) as textbooks have it."""

HEAD = (
    "| three vectors with 5 mm of noise | solver | worst angle to the optimum | unsolved | time of a problem |\n"
    "|---|---|---|---|---|"
)
#: Newton's method on QUEST's characteristic polynomial ends when a step is below this share of the eigenvalue.
QUEST_STEP = 1e-12
NOISE_M = 0.005


def table(options):
    try:
        import numpy as np
        from scipy.spatial.transform import Rotation
    except ImportError as error:
        return f"skipped: {error}", None
    from . import numbers

    count = 500 if options.quick else 5000
    random = np.random.default_rng(1)
    rows = [HEAD]
    for name, body, turn in problems(np, Rotation, random, count):
        measured = np.stack([r.apply(b) for r, b in zip(turn, body)]) + NOISE_M * random.standard_normal(body.shape)
        both = np.stack([body, measured], axis=1)
        best = [optimum(np, *pair) for pair in both]
        ours_ns, quaternions = numbers.kurs("wahba", both.reshape(count, 18))
        found = [("Kurs", ours_ns, [Rotation.from_quat(q[[1, 2, 3, 0]]) for q in quaternions])]
        align = lambda pair: Rotation.align_vectors(pair[1], pair[0])[0]
        found.append(("scipy", *numbers.others(align, both)))
        time_ns, vectors = numbers.others(lambda pair: quest(np, *pair), both)
        found.append(("QUEST", time_ns, [None if q is None else Rotation.from_quat(q) for q in vectors]))
        for solver, time_ns, rotations in found:
            solved = [(r, b) for r, b in zip(rotations, best) if r is not None]
            off = max((r * Rotation.from_matrix(b).inv()).magnitude() for r, b in solved)
            rows.append(f"| {name} | {solver} | {np.degrees(off):.1e}° | {count - len(solved)} | {numbers.duration(time_ns)} |")
    return "\n".join(rows), None


def problems(np, Rotation, random, count):
    """Name, body vectors, rotations: where solvers differ."""
    cube = random.uniform(-1, 1, (count, 3, 3))
    yield "random, a metre", cube, Rotation.random(count, rng=random)
    axes = random.standard_normal((count, 3))
    half = axes / np.linalg.norm(axes, axis=1)[:, None] * np.pi
    yield "half turns", random.uniform(-1, 1, (count, 3, 3)), Rotation.from_rotvec(half)
    line = random.uniform(-1, 1, (count, 1, 3)) * np.array([1.0, 2.0, -1.5])[:, None]
    yield "within 2 cm of a line", line + 0.02 * random.standard_normal((count, 3, 3)), Rotation.random(count, rng=random)
    roof = random.uniform(-1, 1, (count, 3, 3)) * np.array([0.05, 0.05, 0.0])
    yield "a plane, 5 cm", roof, Rotation.random(count, rng=random)


def optimum(np, body, measured):
    """By the SVD of the attitude profile matrix, rotations only (Markley 1988): local from body."""
    u, _, v = np.linalg.svd(measured.T @ body)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(v)]) @ v


def quest(np, body, measured):
    """Quaternion x y z w, local from body; nothing where the rotation is a half turn to rounding."""
    # The attitude profile matrix maps measured to body vectors: QUEST's quaternion is the inverse of ours.
    profile = body.T @ measured
    sigma, s = np.trace(profile), profile + profile.T
    z = np.array([profile[1, 2] - profile[2, 1], profile[2, 0] - profile[0, 2], profile[0, 1] - profile[1, 0]])
    delta = np.linalg.det(s)
    kappa = np.trace(delta * np.linalg.inv(s)) if delta else 0.0
    a, b = sigma**2 - kappa, sigma**2 + z @ z
    c, d = delta + z @ s @ z, z @ s @ s @ z
    largest = 0.5 * (np.sum(body**2) + np.sum(measured**2))
    for _ in range(50):
        value = largest**4 - (a + b) * largest**2 - c * largest + (a * b + c * sigma - d)
        step = value / (4 * largest**3 - 2 * (a + b) * largest - c)
        largest -= step
        if abs(step) < QUEST_STEP * largest:
            break
    alpha, beta = largest**2 - sigma**2 + kappa, largest - sigma
    gamma = (largest + sigma) * alpha - delta
    vector = (alpha * np.eye(3) + beta * s + s @ s) @ z
    norm = np.sqrt(gamma**2 + vector @ vector)
    return None if not norm > 0 else np.append(vector, gamma) / norm
