"""Scenario files: test sequences in simulated time with checks."""
