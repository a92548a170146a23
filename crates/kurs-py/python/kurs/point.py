"""Where one antenna is, by its code observations alone."""

from kurs import _native
from kurs._files import Navigation, OfFiles, Paths, paths


def solve(obs: Paths, nav: Navigation, *, elevation_mask_deg: float = 10.0) -> OfFiles:
    """Place of one antenna at every epoch: time_gpst, latitude_deg, …, x_m, y_m, z_m (ECEF), clock_bias_m, satellites.

    NaN where the satellites do not determine a place. `obs`: one file or several in any order; epochs of a file that are not
    later than those before are skipped, which `damage` of the table tells.
    """
    if not isinstance(nav, Navigation):
        raise TypeError(f"nav is {nav!r}, expected what read_nav gives")
    return OfFiles(*_native.point_solve(paths(obs), nav.native, elevation_mask_deg))


__all__ = ["solve"]
