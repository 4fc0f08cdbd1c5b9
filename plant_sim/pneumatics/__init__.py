"""Pneumatic laws: equations only, no state and no machine."""
