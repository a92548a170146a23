"""Many runs of one scenario on a Dask cluster: does the scatter of the heading fit its standard deviations?

The seeds are hashes of the configuration and the run, so that any executor gives the same runs.
The same in Rust: `cargo run --release -p kurs-py --example twins monte_carlo`.
"""

import kurs
import numpy as np
from distributed import Client, LocalCluster


def main() -> None:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        runs = kurs.batch.monte_carlo("roof-static", 10, executor=client.get_executor(), duration_s=10)
    squares = []
    for run in range(len(runs)):
        rows, truth = runs.attitude(run), runs.truth(run)
        error = rows["heading_deg"] - truth["heading_deg"][: rows.rows]
        squares.extend((error / rows["heading_sd_deg"])[rows["status"] == "fixed"] ** 2)
    print(f"{len(runs)} runs, {len(squares)} fixed epochs")
    print(f"mean square of error over standard deviation between 0.5 and 2: {0.5 < np.mean(squares) < 2}")


if __name__ == "__main__":
    main()

#> 10 runs, 210 fixed epochs
#> mean square of error over standard deviation between 0.5 and 2: True
