"""The controller: a soft PLC and its program; it can be installed and run alone."""
