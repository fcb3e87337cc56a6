"""`uuv gallery`: makes the pictures of the documents again, in a checkout."""

from collections.abc import Sequence
from dataclasses import dataclass

from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import parse


@dataclass(kw_only=True)
class GalleryOptions:
    """Run the jobs of the gallery, draw its pictures, and write docs/gallery.md."""

    only: tuple[str, ...] = ()
    """Names of pictures; default: all."""


def main(verb: str, args: Sequence[str]) -> int:
    """Makes the pictures; returns the exit code."""
    del verb
    options = parse(GalleryOptions, args)
    from uuv.pictures.gallery import entries, make

    known = {shown.name: shown for shown in entries()}
    for name in options.only:
        if name not in known:
            raise ConfigurationError(
                f"only: the gallery has {', '.join(known)}, got {name!r}{did_you_mean(name, known)}"
            )

    make([shown for name, shown in known.items() if name in (options.only or known)])
    return 0
