"""The command line: parses, calls, prints."""

from gaugeblock.cli.commands import app, main

__all__ = ["app", "main"]
