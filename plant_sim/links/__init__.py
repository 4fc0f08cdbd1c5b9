"""Ways to the simulated machine: its remote I/O, in process and as a Modbus TCP server."""
