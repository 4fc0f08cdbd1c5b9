"""Simulated transplanter, and the digital twin that couples it to the controller."""
