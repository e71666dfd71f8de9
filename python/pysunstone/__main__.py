"""``python -m pysunstone`` is the command ``sunstone``."""

from pysunstone._command import main

main()
