"""Modbus served: connections and requests guarded around pymodbus' encoding; what is served is the caller's business.

Both servers of the project stand on it: the operator's side of the controller, and the simulated plant.
"""
