"""Access of communication partners to the devices of a PLC, and one thread with TCP ports and serial lines for it."""
