"""Integers from real-valued ambiguities: cycles and cycles²; baselines in metres."""

from kurs._native import Candidates, array_constrained, lambda_, length_constrained, success_rate

__all__ = ["Candidates", "array_constrained", "lambda_", "length_constrained", "success_rate"]
