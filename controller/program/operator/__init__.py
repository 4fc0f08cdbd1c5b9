"""Commands of the operator: their conditions, refusals, answers to questions and next useful presses."""
