"""Stories on the twin: operator actions and faults whose outcomes with a changed program are compared."""
