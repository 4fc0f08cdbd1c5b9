"""Development tools of the repository, which are not installed."""
