"""Simulated transplanter, and its digital twin with the controller."""
