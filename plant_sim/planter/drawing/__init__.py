"""Figures and animations of the chain planter; the simulation does not import this package."""
