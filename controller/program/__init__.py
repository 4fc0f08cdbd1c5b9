"""The program of this machine: tags, commands, modes, arms, tray feeder, alarms, interlocks."""
