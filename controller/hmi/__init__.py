"""Operator interfaces of the controller: Modbus server, console, web panel."""
