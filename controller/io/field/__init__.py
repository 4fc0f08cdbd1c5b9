"""Field I/O of several Modbus devices: description file, profiles of modules, lines and the composed link."""
