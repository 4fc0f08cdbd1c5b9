"""Web panel: a separate process that reaches the controller over Modbus only."""
