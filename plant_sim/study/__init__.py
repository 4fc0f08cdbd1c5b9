"""Studies: the experiments of both papers, and studies defined by the user."""
