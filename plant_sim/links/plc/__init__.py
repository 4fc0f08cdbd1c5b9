"""Plant as client of a PLC: reads the outputs of the PLC and writes the inputs of the machine into its memory."""
