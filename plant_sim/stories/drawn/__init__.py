"""Random stories: drawn faults and actions, harm judged by the monitors of the plant, coverage, and minimising."""
