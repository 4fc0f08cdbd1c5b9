"""Web panel: a separate process that communicates with the controller over Modbus only."""
