"""Units, limits of parameters, and compilation to machine code."""
