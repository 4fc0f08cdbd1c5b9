"""FX2N instruction lists and GX Works2 CSV files: reader, checks and writer."""
