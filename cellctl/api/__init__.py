"""REST, WebSocket and the console's files: the web process."""
