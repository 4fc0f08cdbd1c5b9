"""Command line of the controller: one module for each command."""
