"""Studies defined by the user in a YAML file."""
