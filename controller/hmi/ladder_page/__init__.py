"""Web page of the ladder of a program with its power flow."""
