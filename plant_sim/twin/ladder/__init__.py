"""Trials of FX programs in place of the controller, with the scan times of a real PLC."""
