"""Access of communication partners to the machine's program, with the server and the list of its tags."""
