"""The command `sunstone`, run in a separate process."""

# pyright: basic
from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig

__all__ = ["CommandError", "find", "run"]


class CommandError(ValueError):
    """The command failed or was not found. The text is the command's message."""


def find() -> str:
    """Return the path of the command: the value of the environment variable SUNSTONE, else `sunstone` in this Python's scripts
    folder, else on the PATH.
    """
    scripts = sysconfig.get_path("scripts")
    found = os.environ.get("SUNSTONE") or shutil.which("sunstone", path=scripts) or shutil.which("sunstone")
    if not found:
        raise CommandError("command `sunstone` not found: add its folder to the PATH, or set the environment variable SUNSTONE to its path")
    return found


def run(*words: object, command: str | None = None, tied: bool = False) -> str:
    """Run the command and return its output.

    Parameters
    ----------
    words
        Arguments of the command.
    command
        Path of the command; by default the result of `find`.
    tied
        End the command when this process ends, if the operating system supports it.

    Raises
    ------
    CommandError
        With the command's message, if it fails.
    """
    name = command or find()
    if shutil.which(name) is None:
        raise CommandError(f"no command `{name}`: install the command, or pass its path")
    ties = shutil.which("setpriv") if tied else None
    tie = [ties, "--pdeathsig", "KILL"] if ties else []
    done = subprocess.run([*tie, name, *map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CommandError(done.stderr.strip() or f"{name} ended with code {done.returncode}")
    return done.stdout
