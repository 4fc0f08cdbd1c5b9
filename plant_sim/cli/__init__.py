"""Command line of the plant: one module for each command."""
