"""The built-in scene: a table with things on it, rendered with the errors of a depth camera."""
