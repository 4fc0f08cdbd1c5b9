"""Command ``study`` with its campaigns and progress display."""
