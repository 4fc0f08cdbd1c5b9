"""Results of the benchmark: file, report and page of the documentation."""
