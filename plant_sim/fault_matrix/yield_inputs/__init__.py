"""Fault matrix of a machine with its yield inputs wired, and with their own faults."""
