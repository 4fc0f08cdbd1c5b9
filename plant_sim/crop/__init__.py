"""Seedlings on their way from the tray into a cup."""
