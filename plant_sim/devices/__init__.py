"""The moving parts of the machine: coils go in, positions and switches come out."""
