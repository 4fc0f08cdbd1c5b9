"""Soft PLC and control program of the seedling transplanter; independent of the plant package."""
