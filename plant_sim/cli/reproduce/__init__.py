"""Provenance of the results of commands, and the command that reproduces them."""
