"""Formal verification of a Program: proofs for all inputs, and counter-example traces."""
