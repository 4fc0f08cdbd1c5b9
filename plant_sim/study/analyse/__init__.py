"""Analysis of a table of trials that somebody else measured."""
