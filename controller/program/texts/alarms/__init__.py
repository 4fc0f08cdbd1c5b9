"""Alarm texts: messages, meaning, likely causes in the order in which to look, and the isolation of the machine."""
