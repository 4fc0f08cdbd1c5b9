"""End of a trial: events of the controller as they are reported, and the rule by which every kind of trial ends."""
