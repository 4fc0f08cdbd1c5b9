"""The PLC: devices, expressions, rungs, sequences, timers, counters, the scan, retentive memory."""
