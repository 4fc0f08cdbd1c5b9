"""Tools of the test suite: the command behind ``scripts/test``, its parts, and the budgets of processor time."""
