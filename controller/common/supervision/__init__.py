"""Supervision of the processes and threads of a command."""
