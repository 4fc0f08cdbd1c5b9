"""Devices of the machine: coils are inputs, positions and switches are outputs."""
