"""Benchmarks for the speeds stated in the documentation."""
