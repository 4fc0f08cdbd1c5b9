"""PLC core: devices, expressions, rungs, sequences, timers, counters, the scan and retentive memory."""
