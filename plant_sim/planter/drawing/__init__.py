"""Figures and animations of the chain planter; the models do not import it."""
