"""Code shared by controller and plant: Modbus framing, YAML with line numbers, command-line helpers, file lock."""
