"""Where one antenna is, by its code observations alone."""

from kurs import _native
from kurs._files import Navigation, Paths, paths
from kurs._table import Table


def solve(obs: Paths, nav: Navigation, *, elevation_mask_deg: float = 10.0) -> Table:
    """Place of one antenna at every epoch: time_gpst, latitude_deg, …, x_m, y_m, z_m (ECEF), clock_bias_m, satellites.

    NaN where the satellites do not determine a place.
    """
    return Table(_native.point_solve(paths(obs), nav.native, elevation_mask_deg))


__all__ = ["solve"]
