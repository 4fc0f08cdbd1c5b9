"""Command `ladder` with its subcommands."""
