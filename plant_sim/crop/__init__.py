"""What happens to a seedling on its way from the tray into a cup."""
