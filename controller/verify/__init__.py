"""Formal verification of a program: proofs for all inputs, and counter-example traces."""
