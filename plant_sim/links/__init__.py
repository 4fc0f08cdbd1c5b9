"""Links to the simulated machine: remote I/O, in-process or as a Modbus TCP server."""
