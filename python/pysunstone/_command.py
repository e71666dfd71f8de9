"""The command ``sunstone`` of the package."""

from __future__ import annotations

import signal
import sys

from pysunstone import _native


def main() -> None:
    """Run the command line in this process, as the program ``sunstone`` does."""
    # Ctrl-C is for the command, which finishes what is in flight; Python would only hear of it at the end.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.command(["sunstone", *sys.argv[1:]]))
