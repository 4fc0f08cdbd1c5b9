"""Mutants of a program: one change each, and the proofs that detect it."""
