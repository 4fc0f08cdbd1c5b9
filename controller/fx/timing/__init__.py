"""Estimated scan time of a real FX2N."""
