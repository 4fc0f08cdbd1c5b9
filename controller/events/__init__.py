"""Alarms, cycles and production events derived from the PLC memory after each scan."""
