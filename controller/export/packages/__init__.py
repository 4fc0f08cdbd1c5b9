"""Packages of the machine's program for real PLCs: one module and one folder of files per target."""
