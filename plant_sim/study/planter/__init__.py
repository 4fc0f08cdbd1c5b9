"""Studies of the chain planter: verdicts of falls, release window, lodging and injury."""
