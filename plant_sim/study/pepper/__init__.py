"""The pepper paper's experiments, and the calibration of the seedling model."""
