"""FX2N: instruction lists read, written, checked, drawn and run."""
