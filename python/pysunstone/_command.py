"""Entry point of the command ``sunstone``."""

from __future__ import annotations

import signal
import sys

from pysunstone import _native


def main() -> None:
    """Run the command line in this process, like the program ``sunstone``."""
    # The command itself handles Ctrl-C and finishes the work in flight. Python's own handler would run only after the command
    # ends.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.command(["sunstone", *sys.argv[1:]]))
