"""The command `uuv`, as `python -m uuv`."""

from uuv.cli.main import main

if __name__ == "__main__":  # a worker process imports this file too
    main()
