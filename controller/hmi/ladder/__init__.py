"""Live simulation of any FX program, with the devices open to communication partners."""
