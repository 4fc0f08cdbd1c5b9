"""Runs of a program with a stimulus: its file, the run, what it must show."""
