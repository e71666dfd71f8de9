"""Run the command ``sunstone`` as ``python -m pysunstone``."""

from pysunstone._command import main

main()
