"""Which baselines of an array to process."""

from kurs._native import select

__all__ = ["select"]
