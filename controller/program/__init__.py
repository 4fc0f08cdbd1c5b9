"""PLC program of the transplanter: tags, commands, modes, arms, tray feeder, alarms, interlocks."""
