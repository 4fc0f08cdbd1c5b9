"""FX3U device map served to operator panels over Modbus."""
