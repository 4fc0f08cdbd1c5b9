"""Question why a device is on or off: from its rung through past scans to the input or the physical cause."""
