"""Devices connected to the CPU: special function modules and the serial line."""
