"""Applied instructions, one module for each family."""
