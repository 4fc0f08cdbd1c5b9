"""Study reports: tables, pictures, Markdown, HTML and JSON."""
