"""Pneumatic laws: equations without stored state, independent of the machine."""
