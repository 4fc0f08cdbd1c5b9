"""Commissioning of the wiring: every point in turn, judged by its reaction, and a report to sign."""
