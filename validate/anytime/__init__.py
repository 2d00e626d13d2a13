"""Watching trials come in, with error rates that hold whenever one stops."""
