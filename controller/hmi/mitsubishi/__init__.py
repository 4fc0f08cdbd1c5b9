"""Mitsubishi servers: MC protocol over TCP and the programming port of an FX on a serial line."""
