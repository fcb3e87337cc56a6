"""Files of pictures: stills, and clips as animated WebP of a limited size."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.spatial import finite_number, shown
from uuv.sim.runs.saving import write_whole

MOST_BYTES = 1_500_000  # of a clip
QUALITIES = (75, 55, 36, 20)  # tried until the clip is small enough
LEAST_RATE = 0.1  # [1/s] pictures shown in a second
MOST_RATE = 60.0  # [1/s] likewise
_KINDS = {".png": "png", ".webp": "webp", ".jpg": "jpeg"}  # as Pillow names them
ENDINGS = {"still": (*_KINDS,), "clip": (".webp",)}


def check_file(file: Path, what: str) -> None:
    """Refuse a file for a "still" or a "clip" with a wrong ending, or in a missing folder."""
    if file.suffix not in ENDINGS[what]:
        raise ConfigurationError(
            f"{what}: must be a file *{', *'.join(ENDINGS[what])}, got {shown(file.name)}"
        )
    if not file.parent.is_dir():
        raise ConfigurationError(f"{what}: there is no folder {shown(str(file.parent))}")


def check_rate(rate: float) -> None:
    """Refuses a rate of a clip [1/s]."""
    finite_number(rate, "rate of a clip [1/s]", least=LEAST_RATE, most=MOST_RATE)


def write_still(file: Path, picture: np.ndarray) -> None:
    """Write a picture (h, w, 3) as PNG, WebP or JPEG, by the file's ending.

    Raises:
        ConfigurationError: The ending is another, or there is no such folder.
        MissingLibraryError: Pillow is not installed.
    """
    check_file(file, "still")
    write_whole(file, still(picture, _KINDS[file.suffix]))


def still(picture: np.ndarray, kind: str) -> bytes:
    """Content of a file of a picture (h, w, 3); `kind` as Pillow names it."""
    return _encoded([picture], kind, quality=86)


def write_clip(file: Path, pictures: Sequence[np.ndarray], rate: float) -> int:
    """Write pictures (h, w, 3) as an animated WebP of at most MOST_BYTES, which repeats.

    Args:
        file: *.webp
        pictures: At least two of one size.
        rate: [1/s] pictures shown in a second.

    Returns:
        Its size [B].

    Raises:
        ConfigurationError: Another ending, or even the lowest quality takes more.
        MissingLibraryError: Pillow is not installed.
    """
    check_file(file, "clip")
    check_rate(rate)

    content = b""
    for quality in QUALITIES:
        content = _encoded(
            pictures,
            "webp",
            save_all=True,
            duration=round(1e3 / rate),
            loop=0,
            quality=quality,
            method=2,
            kmin=0,  # no pictures in full but the first
            kmax=0,
        )
        if len(content) <= MOST_BYTES:
            write_whole(file, content)
            return len(content)

    raise ConfigurationError(
        f"clip {file.name}: {len(content) / 1e6:.1f} MB at the lowest quality, "
        f"{MOST_BYTES / 1e6:g} MB allowed; take fewer or smaller pictures"
    )


def _encoded(pictures: Sequence[np.ndarray], kind: str, **options: Any) -> bytes:
    with wanted():
        from PIL import Image

    first, *others = (Image.fromarray(picture) for picture in pictures)
    if others:
        options["append_images"] = others
    content = io.BytesIO()
    first.save(content, format=kind, **options)
    return content.getvalue()
