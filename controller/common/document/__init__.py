"""Documents of headings, texts, tables and pictures, as plain text, Markdown, HTML and CSV."""
