"""Modbus server core: connection handling and request checks around the pymodbus codec, for any data model.

It is used by both servers of the project: the operator interface of the controller and the simulated plant.
"""
