"""The command line: `grasptransfer …`, one file for each group of commands."""

from grasptransfer.cli.main import main

__all__ = ["main"]
