"""Execution of FX2N programs by translation to Python functions."""
