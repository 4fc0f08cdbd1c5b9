"""Provenance of results, and the files that carry it."""
