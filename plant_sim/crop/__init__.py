"""Seedlings, from the tray to the cup."""
