"""Size of an experiment and its order of runs, before anything runs."""
