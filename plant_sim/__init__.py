"""The machine in software; of the controller it knows only the I/O map."""
