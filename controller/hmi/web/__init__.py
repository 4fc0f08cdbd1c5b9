"""Parts of all web pages: checks of the requests, and the web server."""
