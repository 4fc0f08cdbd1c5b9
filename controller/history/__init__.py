"""History in SQLite: writer, queries, export and summary."""
