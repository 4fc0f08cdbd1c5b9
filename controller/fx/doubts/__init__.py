"""Doubts about the results of a program, by pages of the manuals."""
