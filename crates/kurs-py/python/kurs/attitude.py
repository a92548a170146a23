"""Rotations from vectors, baselines, phases and points: `local_from_body`, angles in degrees, covariance in body axes."""

from kurs._native import Attitude, angles, from_phases, general, relative, three_point, wahba, weighted

__all__ = ["Attitude", "angles", "from_phases", "general", "relative", "three_point", "wahba", "weighted"]
