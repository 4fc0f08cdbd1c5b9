"""Planting lines, from trays or a conveyor of blocks to rows of plants in the ground."""
