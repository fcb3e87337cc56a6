"""Controllers: state estimates and references to commands."""

if __name__ != "uuv.controllers":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.controllers")
