"""Test bench that judges any controller of the machine by its outputs and by the simulated machine."""
