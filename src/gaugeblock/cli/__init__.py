"""The command line: parses, calls, prints."""

from gaugeblock.cli.app import main

__all__ = ["main"]
