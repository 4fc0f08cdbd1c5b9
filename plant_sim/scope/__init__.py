"""Oscilloscope of the plant: recordings in columnar files, and plots of them."""
