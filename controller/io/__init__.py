"""Field I/O of the controller: links, runtime, scan loops and forcing."""
