"""Throughput study: planting frequency, critical path, driving speed."""
