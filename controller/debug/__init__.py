"""Recorded runs of a simulated machine that can be returned to, searched, and run on with a change."""
