"""Recorded runs of the twin: what enters it, its devices and values, changes for branches."""
