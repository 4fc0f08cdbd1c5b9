"""Web server of the panel: routes, request checks, login, WebSockets."""
