"""I/O map: reader and schema of `io_map.yaml`."""
