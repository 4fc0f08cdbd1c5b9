"""The operator panel: a web page beside the controller, which it knows over Modbus alone."""
