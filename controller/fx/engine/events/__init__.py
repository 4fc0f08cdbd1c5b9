"""Events between two scans: edges at fast inputs, high-speed counters and interrupts."""
