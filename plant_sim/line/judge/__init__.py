"""Judges of planted rows: targets and verdicts, area capacity, and the domain of the models."""
