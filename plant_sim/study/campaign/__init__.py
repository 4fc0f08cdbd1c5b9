"""Campaigns: many runs over factors, faults and seeds, stored as Parquet files and resumed by content."""
