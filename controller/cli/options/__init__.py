"""Options of the commands that need an extra, in modules that import none."""
