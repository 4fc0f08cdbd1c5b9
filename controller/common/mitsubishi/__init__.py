"""Mitsubishi protocols as pure functions: MC protocol frames 1E, 3E and 4E, programming-port frames, and a client."""
