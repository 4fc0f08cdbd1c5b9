"""Fault matrix: trials of every fault at several times, their evaluation and their tables."""
