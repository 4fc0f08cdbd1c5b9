"""Studies of the chain planter: verdicts, release window, lodging and injury."""
