"""Wahba's problem: kurs against scipy's Rotation.align_vectors, called once per epoch.

    cargo build --release -p kurs --example wahba_epochs
    python3 bench/align_vectors.py target/release/examples/wahba_epochs

Same random problems for both, compared as quaternions; prints both times and their ratio.
"""

import subprocess
import sys
import time

try:
    import numpy as np
    from scipy.spatial.transform import Rotation
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(0)

EPOCHS = 5000


def main(program):
    random = np.random.default_rng(1)
    body = random.uniform(-1, 1, (EPOCHS, 3, 3))
    truth = Rotation.random(EPOCHS, random_state=1)
    measured = np.stack([truth[k].apply(body[k]) for k in range(EPOCHS)])
    measured += 0.005 * random.standard_normal(measured.shape)

    started = time.perf_counter()
    theirs = [Rotation.align_vectors(measured[k], body[k])[0] for k in range(EPOCHS)]
    scipy_ns = (time.perf_counter() - started) * 1e9 / EPOCHS

    numbers = np.concatenate([body.reshape(EPOCHS, 9), measured.reshape(EPOCHS, 9)], axis=1)
    text = "\n".join(" ".join(repr(float(x)) for x in row) for row in numbers)
    lines = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    kurs_ns, *rows = lines.stdout.splitlines()
    ours = np.array([[float(x) for x in row.split()] for row in rows])
    theirs = np.array([rotation.as_quat()[[3, 0, 1, 2]] for rotation in theirs])
    difference = np.minimum(abs(ours - theirs), abs(ours + theirs)).max()

    ratio = scipy_ns / float(kurs_ns)
    print(f"scipy {scipy_ns:.0f} ns, kurs {float(kurs_ns):.0f} ns: {ratio:.0f} times faster")
    print(f"largest difference of the quaternions {difference:.1e}")
    sys.exit(0 if difference < 1e-9 and ratio >= 100 else 1)


if __name__ == "__main__":
    main(sys.argv[1])
