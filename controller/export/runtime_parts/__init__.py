"""Statements around the machine's program in Structured Text: clock, supervision, inputs, memory and shown values."""
