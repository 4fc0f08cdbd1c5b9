"""Links to the simulated machine: remote I/O in process and as a Modbus TCP server."""
