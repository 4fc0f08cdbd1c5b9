"""Options of the commands: one module per command, which imports none of the extras."""
