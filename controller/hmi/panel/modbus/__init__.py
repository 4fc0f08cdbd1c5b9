"""Modbus client of the web panel: connection, mirror of the controller's devices, telemetry of the plant."""
