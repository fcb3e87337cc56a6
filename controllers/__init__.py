"""Controllers, which turn state estimates and references into commands."""

if __name__ != "uuv.controllers":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.controllers")
