"""The command `uuv`, as `python -m uuv`."""

from uuv.cli.main import main

main()
