"""Servers for communication partners: one thread with several TCP ports and serial lines."""
