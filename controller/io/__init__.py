"""Links from the controller to the field: the machine's inputs and outputs."""
