"""Access of communication partners to the devices of a PLC, independent of the protocol."""
