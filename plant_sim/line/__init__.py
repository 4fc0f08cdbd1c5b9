"""Lines from the tray, or the conveyor of blocks, to rows of plants in the ground."""
