"""Parser, checks, drawing and execution engine for FX2N programs."""
