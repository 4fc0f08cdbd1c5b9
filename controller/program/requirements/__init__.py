"""Requirements of the machine: safety, supporting invariants, and ways out of every situation."""
