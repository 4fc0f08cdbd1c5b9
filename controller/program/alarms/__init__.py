"""Alarms: table of the annunciators, step time limits, and the rungs that set and reset them."""
