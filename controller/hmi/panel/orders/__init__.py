"""Orders from a browser: permissions, messages, replies, jogging."""
