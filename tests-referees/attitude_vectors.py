#!/usr/bin/env python3
"""Random attitude, three-point and baseline cases with answers found another way, in the format of
the project's vectors: multistart Newton in 40 digits, scipy's align_vectors, and brute force over all graphs.

    python3 tests-referees/attitude_vectors.py FOLDER [SEED]
    KURS_VECTORS=FOLDER cargo test --release -p kurs --test vectors -- --nocapture
"""
import itertools
import json
import pathlib
import sys

import mpmath
import numpy as np
from scipy.spatial.transform import Rotation

mpmath.mp.dps = 40
ROTATIONS_OF_REFEREE = 200


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


# --- the attitude cost ½ qᵀGq − hᵀq, q the columns of Q one after the other ---------------------------

def cost(G, h, Q):
    q = Q.T.reshape(9)
    return 0.5 * q @ G @ q - h @ q


def derivatives(G, h, Q):
    q = Q.T.reshape(9)
    T = np.column_stack([(Q @ skew(e)).T.reshape(9) for e in np.eye(3)])
    slope = G @ q - h
    M = slope.reshape(3, 3).T  # ∂F/∂Q
    information = T.T @ G @ T
    curvature = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            ei, ej = skew(np.eye(3)[i]), skew(np.eye(3)[j])
            curvature[i, j] = np.sum(M * (Q @ (ei @ ej + ej @ ei) / 2))
    return T.T @ slope, information, information + curvature


def descend(G, h, Q):
    """Damped Newton; the local minimum below Q, or None."""
    for _ in range(200):
        gradient, _, hessian = derivatives(G, h, Q)
        values, vectors = np.linalg.eigh(hessian)
        step = -vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(values), 1e-6 * np.abs(values).max()))
        scale = min(1.0, 1.0 / max(np.linalg.norm(step), 1e-300))
        here = cost(G, h, Q)
        while True:
            there = Q @ Rotation.from_rotvec(scale * step).as_matrix()
            if cost(G, h, there) <= here + 1e-13 * abs(here) or scale < 1e-10:
                break
            scale /= 2
        Q = there
        if np.linalg.norm(step) < 1e-9:
            return Q if np.linalg.eigvalsh(derivatives(G, h, Q)[2]).min() > 0 else None
    return None


def polished(G, h, Q):
    """Newton in 40 digits."""
    G, h, Q = mpmath.matrix(G), mpmath.matrix(h), mpmath.matrix(Q)
    E = [mpmath.matrix(skew(e)) for e in np.eye(3)]
    vec = lambda M: mpmath.matrix([M[i, j] for j in range(3) for i in range(3)])
    for _ in range(4):
        q = vec(Q)
        slope = G * q - h
        columns = [vec(Q * e) for e in E]
        K = mpmath.matrix(3, 3)
        for i in range(3):
            for j in range(3):
                both = vec(Q * (E[i] * E[j] + E[j] * E[i]) / 2)
                K[i, j] = (columns[i].T * G * columns[j])[0] + (slope.T * both)[0]
        g = mpmath.matrix([(c.T * slope)[0] for c in columns])
        t = -mpmath.lu_solve(K, g)
        S = mpmath.matrix([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
        turn, power = mpmath.eye(3), mpmath.eye(3)
        for k in range(1, 12):
            power = power * S / k
            turn += power
        Q = Q * turn
        for _ in range(3):  # back onto the rotations
            Q = (Q * 3 - Q * Q.T * Q) / 2
    q = vec(Q)
    value = ((q.T * G * q)[0] / 2 - (h.T * q)[0])
    return np.array([[float(Q[i, j]) for j in range(3)] for i in range(3)]), float(value), value


def minima(G, h, random):
    """All local minima that random starts reach, lowest first: rotation, cost, exact cost."""
    found = []
    for start in Rotation.random(ROTATIONS_OF_REFEREE, random_state=random).as_matrix():
        Q = descend(G, h, start)
        if Q is not None and all(np.linalg.norm(Q - other) > 1e-5 for other in found):
            found.append(Q)
    return sorted((polished(G, h, Q) for Q in found), key=lambda minimum: minimum[1])


def put_minimum(expected, prefix, G, h, random):
    all_minima = minima(G, h, random)
    (Q, value, exact) = all_minima[0]
    expected[prefix + "Q"] = Q.tolist()
    expected[prefix + "cost_reduced"] = value
    if len(all_minima) > 1:
        expected[prefix + "second_Q"] = all_minima[1][0].tolist()
        expected[prefix + "next_local_min_cost_gap"] = float(all_minima[1][2] - exact)
    return Q


def phase_case(name, random, los, body, noise, Q=None, wavelengths=(0.1903, 0.2442)):
    n, k = len(los), body.shape[1]
    if Q is None:
        Q = Rotation.random(random_state=random).as_matrix()
    sigma = noise * random.uniform(0.02, 0.07, 2 * n) * np.repeat(wavelengths, n)
    H = -np.vstack([los, los])
    phi = H @ Q @ body + random.uniform(-50, 50, k) + sigma[:, None] * random.standard_normal((2 * n, k))
    w = sigma**-2
    mp = lambda array: mpmath.matrix(np.atleast_2d(array).tolist())
    weight = mpmath.diag([mpmath.mpf(1) / mpmath.mpf(float(s)) ** 2 for s in sigma])
    ones = mpmath.ones(2 * n, 1)
    projected = weight - weight * ones * ones.T * weight / (ones.T * weight * ones)[0]
    N, b = mp(H).T * projected * mp(H), mp(H).T * projected * mp(phi)
    expected = {"N": [[float(N[i, j]) for j in range(3)] for i in range(3)]}
    condition = np.linalg.cond(np.array(expected["N"]))
    if condition < 1e9:
        L = N**-1 * b
        L = np.array([[float(L[i, j]) for j in range(k)] for i in range(3)])
        expected["L_star"] = L.tolist()
        expected["wahba_Q"] = Rotation.align_vectors(L.T, body.T)[0].as_matrix().tolist()
    line = np.linalg.matrix_rank(body, tol=1e-9) == 1
    m = k + 1
    for prefix, C in (("diag_", np.eye(k)), ("full_", 2 * (np.eye(k) - np.ones((k, k)) / m))):
        R = mp(body) * mp(C) * mp(body).T
        X = b * mp(C) * mp(body).T
        G = mpmath.matrix(9, 9)
        for a in range(9):
            for c in range(9):
                G[a, c] = R[a // 3, c // 3] * N[a % 3, c % 3]
        h = mpmath.matrix([X[i, j] for j in range(3) for i in range(3)])
        Gd = np.array([[float(G[i, j]) for j in range(9)] for i in range(9)])
        hd = np.array([float(x) for x in h])
        if line:
            axis = body[:, -1] / np.linalg.norm(body[:, -1])
            s = mp(axis.reshape(3, 1)).T * mp(body)
            rho, c = (s * mp(C) * s.T)[0], b * mp(C) * s.T
            expected["body_axis"] = axis.tolist()
            expected[prefix + "direction"] = direction(rho * N, c)
            continue
        best = put_minimum(expected, prefix, Gd, hd, random)
        if prefix == "full_":
            info = derivatives(Gd, hd, best)[1]
            expected["full_info_gn_body"] = info.tolist()
            expected["full_cov_gn_body"] = np.linalg.inv(info).tolist()
            expected["full_sd_clock_m"] = ((w @ (phi - H @ best @ body)) / w.sum()).tolist()
    return {"kind": "phase_collinear" if line else "phase", "name": name, "expected": expected, "input": {
        "los": los.tolist(), "sigma_sd_m": sigma.tolist(), "body": body.tolist(), "phi_sd_m": phi.tolist()}}


def direction(A, c):
    """min ½uᵀAu − cᵀu, |u| = 1: the secular equation by bisection in 40 digits."""
    values, vectors = mpmath.eigsy(A)
    c = vectors.T * c
    norm = lambda shift: sum((c[i] / (values[i] + shift)) ** 2 for i in range(3))
    low, high = -values[0], -values[0] + mpmath.norm(c) * 2 + 1
    low += abs(low) * mpmath.mpf(10) ** -35
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if norm(middle) > 1 else (low, middle)
    u = vectors * mpmath.matrix([c[i] / (values[i] + low) for i in range(3)])
    return [float(x) for x in u]


def omega_case(name, random, body, noise):
    k = body.shape[1]
    Q = Rotation.random(random_state=random).as_matrix()
    factor = random.standard_normal((3 * k, 3 * k))
    omega = factor @ factor.T + 0.3 * np.eye(3 * k)
    omega = (omega + omega.T) / 2 * 1e4
    z = (Q @ body).T.reshape(3 * k) + noise * random.standard_normal(3 * k)
    T = np.kron(body.T, np.eye(3))
    expected = {}
    put_minimum(expected, "", T.T @ omega @ T, T.T @ omega @ z, random)
    return {"kind": "omega", "name": name, "expected": expected, "input": {
        "body": body.tolist(), "z": z.tolist(), "omega": omega.tolist()}}


def sky(random, n, mask_deg=10):
    elevation = np.arcsin(random.uniform(np.sin(np.radians(mask_deg)), 1, n))
    azimuth = random.uniform(0, 2 * np.pi, n)
    return np.column_stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)])


def cone(random, n, elevation_deg):
    e, azimuth = np.radians(elevation_deg), random.uniform(0, 2 * np.pi, n)
    return np.column_stack([np.cos(e) * np.cos(azimuth), np.cos(e) * np.sin(azimuth), np.full(n, -np.sin(e))])


def attitude_cases(random):
    cases = []
    cube = lambda k: random.uniform(-0.8, 0.8, (3, k))
    for i in range(30):
        n, k = int(random.integers(4, 15)), int(random.integers(2, 6))
        cases.append(phase_case(f"phase{i}_n{n}_k{k}", random, sky(random, n), cube(k), random.choice([0.3, 1, 3])))
    for i in range(10):  # coplanar antennas
        k = int(random.integers(2, 5))
        turn = Rotation.random(random_state=random).as_matrix()
        flat = turn @ (cube(k) * [[1], [1], [0]])
        cases.append(phase_case(f"coplanar{i}_k{k}", random, sky(random, 8), flat, 1))
    for i in range(10):
        k = int(random.integers(1, 5))
        axis = random.standard_normal(3)
        line = np.outer(axis / np.linalg.norm(axis), random.uniform(0.2, 2, k) * random.choice([-1, 1], k))
        cases.append(phase_case(f"collinear{i}_k{k}", random, sky(random, int(random.integers(4, 12))), line, 1))
    for i in range(8):
        cases.append(phase_case(f"cone_3d_{i}", random, cone(random, 7, random.uniform(15, 60)), cube(4), 0.5))
    for i in range(8):
        flat = cube(3) * [[1], [1], [0]]
        cases.append(phase_case(f"cone_planar_{i}", random, cone(random, 6, random.uniform(15, 60)), flat, 0.5))
    for i in range(10):
        axis = random.standard_normal(3)
        half = (np.pi - random.choice([0, 1e-9, 1e-5, 1e-3])) * axis / np.linalg.norm(axis)
        cases.append(phase_case(f"near180_{i}", random, sky(random, 9), cube(3), 0.2, Rotation.from_rotvec(half).as_matrix()))
    for i in range(20):
        cases.append(omega_case(f"omega{i}", random, cube(int(random.integers(2, 6))), random.choice([0.003, 0.02, 0.1])))
    for i in range(5):
        cases.append(omega_case(f"omega_coplanar{i}", random, cube(3) * [[1], [1], [0]], 0.02))
    return cases


# --- three points ------------------------------------------------------------------------------------

def three_point_case(name, random, body, Q, shift, noise):
    measured = body @ Q.T + shift + noise * random.standard_normal((3, 3))
    weights = random.uniform(0.5, 3, 3)
    A, B, C = measured
    legs = [(B - A) @ (C - A), (A - B) @ (C - B), (A - C) @ (B - C)]
    bodily = [(body[1] - body[0]) @ (body[2] - body[0]), (body[0] - body[1]) @ (body[2] - body[1]),
              (body[0] - body[2]) @ (body[1] - body[2])]

    def corner(points, legs):
        s = 1 / np.sqrt(legs)
        H = (points.T * (s**2)).sum(1) / (s**2).sum()
        n = np.cross(points[1] - points[0], points[2] - points[0])
        origin = H - n / np.linalg.norm(n) / np.sqrt((s**2).sum())
        return origin, ((points - origin) / np.sqrt(legs)[:, None]).T

    expected = {"d2": legs[0], "e2": legs[1], "f2": legs[2], "acute": min(legs) > 0, "O_prime": None,
                "M_columns": None, "Q_from_M": None}
    if min(legs) > 0:
        first = A.copy()
        origin, M = corner(measured - first, np.array(legs))
        expected |= {"O_prime": (origin + first).tolist(), "M_columns": M.tolist()}
        if min(bodily) > 0:
            _, N = corner(body, np.array(bodily))
            expected["Q_from_M"] = (M @ N.T).tolist()
    frame = lambda a, b: np.column_stack([a / np.linalg.norm(a), (n := np.cross(a, b)) / np.linalg.norm(n),
                                          np.cross(a / np.linalg.norm(a), n / np.linalg.norm(n))])
    expected["Q_triad_AB_AC"] = (frame(B - A, C - A) @ frame(body[1] - body[0], body[2] - body[0]).T).tolist()
    mean = lambda points: (points.T * weights).sum(1) / weights.sum()
    centre = mean(measured - A) + A
    best, _ = Rotation.align_vectors(measured - centre, body - mean(body), weights=weights)
    t = centre - best.as_matrix() @ mean(body)
    residuals = (measured - centre) - (body - mean(body)) @ best.as_matrix().T
    x, y, z, w = best.as_quat(canonical=True)
    expected |= {"Q_wahba": best.as_matrix().tolist(), "t_wahba": t.tolist(), "quat_wxyz": [w, x, y, z],
                 "rms_residual": float(np.sqrt((weights * (residuals**2).sum(1)).sum() / weights.sum()))}
    return {"kind": "three_point", "name": name, "expected": json.loads(json.dumps(expected, default=bool)), "input": {
        "body": body.tolist(), "measured": measured.tolist(), "weights": weights.tolist()}}


def three_point_cases(random):
    cases = []
    for i, corner_deg in enumerate([40, 60, 75, 85, 88, 89.5, 90.5, 95, 120, 150] * 4):
        other = random.uniform(0.35, 0.65) * (180 - corner_deg)
        a, c = np.radians(corner_deg), np.radians(other)
        b = np.pi - a - c
        # sides by the sine rule, then any pose of the triangle
        body = np.array([[0, 0, 0], [np.sin(c), 0, 0], [np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), 0]])
        body = body @ Rotation.random(random_state=random).as_matrix().T + random.uniform(-1, 1, 3)
        half = random.standard_normal(3)
        turn = Rotation.from_rotvec((np.pi - 10.0 ** -float(random.integers(3, 9))) * half / np.linalg.norm(half))
        turn = turn if i % 2 else Rotation.random(random_state=random)
        # near a right angle, coordinates of this size leave no eight digits
        shift = random.uniform(-10, 10, 3) if i % 10 > 2 else np.array([1253e3, 4732e3, 4074e3])
        cases.append(three_point_case(f"corner{corner_deg}_{i}", random, body, turn.as_matrix(), shift, 0.0005))
    return cases


# --- baselines ---------------------------------------------------------------------------------------

def baseline_case(name, positions):
    n = len(positions)
    pairs = list(itertools.combinations(range(n), 2))
    sets = np.array(list(itertools.combinations(range(len(pairs)), n - 1)), dtype=np.uint8)
    touched = np.zeros(len(sets), dtype=int)
    bits = np.array([(1 << i) | (1 << j) for i, j in pairs])
    for column in sets.T:
        touched |= bits[column]
    sets = sets[touched == (1 << n) - 1]
    reached = np.ones(len(sets), dtype=int)
    for _ in range(n):
        for column in sets.T:
            joined = bits[column]
            reached |= np.where(reached & joined, joined, 0)
    outer = np.array([np.outer(positions[j] - positions[i], positions[j] - positions[i]) for i, j in pairs])
    gram = sum(outer[column] for column in sets.T)
    r = np.linalg.eigvalsh(gram)
    j = np.column_stack([r[:, 0] + r[:, 1], r[:, 0] + r[:, 2], r[:, 1] + r[:, 2]])
    size = r[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        measures = {
            "kappa": (np.where(r[:, 0] > 1e-12 * size, r[:, 2] / r[:, 0], np.inf), 1),
            "kappa_att": (np.where(j[:, 0] > 1e-12 * size, j[:, 2] / j[:, 0], np.inf), 1),
            "lmin_att": (j[:, 0], -1),
            "trace_cov_att": (np.where(j[:, 0] > 1e-12 * size, (1 / j).sum(1), np.inf), 1),
        }
    expected = {}
    for graph, chosen in (("tree", reached == (1 << n) - 1), ("general", np.full(len(sets), True))):
        expected[f"{graph}_count"] = int(chosen.sum())
        for key, (values, sign) in measures.items():
            of_graph = np.where(chosen, sign * values, np.inf)
            best = int(of_graph.argmin())
            value = of_graph[best]
            ties = int((of_graph <= value + 1e-9 * abs(value)).sum())
            expected[f"{graph}_{key}"] = {"value": None} if not np.isfinite(value) else {
                "value": float(sign * value), "ties_within_1e9": ties, "edges": [list(pairs[k]) for k in sets[best]]}
    centred = positions - positions.mean(0)
    expected["centred_R_eigs"] = np.linalg.eigvalsh(centred.T @ centred).tolist()
    return {"kind": "baseline", "name": name, "expected": expected, "input": {"positions": positions.tolist()}}


def baseline_cases(random):
    cases = []
    for n in (3, 4, 5, 6, 7, 8, 8):
        cases.append(baseline_case(f"cube_n{n}_{len(cases)}", random.uniform(-1, 1, (n, 3))))
        flat = random.uniform(-1, 1, (n, 3)) * [1, 1, 0]
        cases.append(baseline_case(f"coplanar_n{n}_{len(cases)}", flat))
        tilted = flat @ Rotation.random(random_state=random).as_matrix().T
        cases.append(baseline_case(f"tilted_coplanar_n{n}_{len(cases)}", tilted))
        cases.append(baseline_case(f"flat_n{n}_{len(cases)}", random.uniform(-1, 1, (n, 3)) * [1, 1, 0.02]))
    corners = np.array(list(itertools.product([0.0, 1.0], repeat=3)))
    cases.append(baseline_case("corners_of_a_cube", corners))
    cases.append(baseline_case("square", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])))
    return cases


def main():
    folder = pathlib.Path(sys.argv[1])
    random = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    folder.mkdir(parents=True, exist_ok=True)
    cases = {"format": "random cases of tests-referees/attitude_vectors.py", "attitude": attitude_cases(random),
             "three_point": three_point_cases(random), "baseline": baseline_cases(random)}
    (folder / "attitude_baseline.json").write_text(json.dumps(cases))
    print({kind: len(group) for kind, group in cases.items() if kind != "format"})


if __name__ == "__main__":
    main()
