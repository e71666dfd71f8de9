"""The command `sunstone`, in a process of its own."""

# pyright: basic
from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig

__all__ = ["CommandError", "find", "run"]


class CommandError(ValueError):
    """The command refused, or there is none; the text is its own."""


def find() -> str:
    """The command: what the variable SUNSTONE names, or `sunstone` of this Python's own scripts, or of the PATH."""
    scripts = sysconfig.get_path("scripts")
    found = os.environ.get("SUNSTONE") or shutil.which("sunstone", path=scripts) or shutil.which("sunstone")
    if not found:
        raise CommandError("there is no command `sunstone`: put it into the PATH, or its place into the variable SUNSTONE")
    return found


def run(*words: object, command: str | None = None, tied: bool = False) -> str:
    """Run the command, and return what it prints.

    Parameters
    ----------
    words
        Its words.
    command
        The command, instead of that of `find`.
    tied
        Whether it dies with this process, where the system can see to that.

    Raises
    ------
    CommandError
        With what the command says, if it fails.
    """
    name = command or find()
    if shutil.which(name) is None:
        raise CommandError(f"there is no command `{name}`: install it, or say where it is")
    ties = shutil.which("setpriv") if tied else None
    tie = [ties, "--pdeathsig", "KILL"] if ties else []
    done = subprocess.run([*tie, name, *map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CommandError(done.stderr.strip() or f"{name} ended with code {done.returncode}")
    return done.stdout
