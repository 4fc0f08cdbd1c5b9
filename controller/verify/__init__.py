"""Proofs about a Program: what it can never do, whatever its inputs do, and a trace where it can."""
