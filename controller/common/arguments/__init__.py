"""Arguments of the command line: ranges of numbers, and completion by a shell."""
