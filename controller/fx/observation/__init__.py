"""Observation of single scans of an FX program, search in a program, and drawing with power flow."""
