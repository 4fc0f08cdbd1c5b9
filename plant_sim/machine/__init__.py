"""The simulated machine: parameters, compiled kernel, arms and plant."""
