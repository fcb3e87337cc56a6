"""Text and bars on a picture of a run: phase, time, force, current, and the scale of colours."""

import importlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.palette import ORANGE, SKY, YELLOW

# Colours of the set and the felt force, and of the current.
SET = YELLOW
FELT = ORANGE
CURRENT = SKY
_WHITE = (255, 255, 255, 255)
_PALE = (225, 236, 240, 255)
_SHADE = (4, 22, 32, 165)  # of the empty bar
_PLATE = (4, 22, 32, 120)  # behind text
_USUAL = 720.0  # [px] height of a picture whose text has the sizes below
_TITLE = 27.0  # [px]
_TEXT = 22.0  # [px]
_SMALL = 18.0  # [px]
_NEAR = 236, 330  # [px] height and width of the tool's picture
_BEYOND = 1.25  # end of the bar over the largest set force
_LEAST = 9.0  # [px] below which no text can be read


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureText:
    """Text on a picture."""

    time: float  # [s]
    phase: str
    touching: bool  # the tool is at the object, or on its way there
    set_force: float  # [N]; 0: none is set
    felt: float  # [N]; NaN: unknown
    current: float  # [m/s] of the water at the hull; NaN: unknown


class Captions:
    """Text and bars for the pictures of a run, of one size."""

    def __init__(
        self, height: int, width: int, title: str, *, most_force: float, error_scale: float | None
    ) -> None:
        """Take the data that all pictures of a run have in common.

        Args:
            height: [px]
            width: [px]
            title: First line.
            most_force: [N] largest set force of the run; 0: none.
            error_scale: [N] error of the force at the end of the path's colours; None: it has none.

        Raises:
            MissingLibraryError: Pillow or Matplotlib is not installed.
        """
        with wanted():
            import matplotlib as mpl  # it brings the font

            importlib.import_module("PIL.ImageDraw")

        fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
        self._plain = str(fonts / "DejaVuSans.ttf")
        self._bold = str(fonts / "DejaVuSans-Bold.ttf")
        self._height = height
        self._width = width
        self._scale = min(height / _USUAL, width / (16.0 / 9.0 * _USUAL))
        self._title = title
        self._most = _BEYOND * most_force
        self._error = error_scale

    @property
    def near_size(self) -> tuple[int, int]:
        """Height and width [px] of the close-up of the tool."""
        return round(self._px(_NEAR[0])), round(self._px(_NEAR[1]))

    def titled(self, picture: np.ndarray) -> np.ndarray:
        """The picture (h, w, 3) with the title alone."""
        from PIL import Image, ImageDraw

        ground = Image.fromarray(picture)
        place = self._px(24), self._px(18)
        self._text(ImageDraw.Draw(ground, "RGBA"), place, self._title, _TITLE, bold=True)
        return np.asarray(ground)

    def on(
        self, picture: np.ndarray, readout: PictureText, near: np.ndarray | None = None
    ) -> np.ndarray:
        """The picture (h, w, 3) with its text, and another of `near_size` within it."""
        from PIL import Image, ImageDraw

        ground = Image.fromarray(picture)
        if near is not None:
            self._within(ground, Image.fromarray(near))
        layer = Image.new("RGBA", ground.size, (0, 0, 0, 0))
        pen = ImageDraw.Draw(layer)
        self._head(pen, readout)
        if self._most > 0.0:
            self._force(pen, readout)
        self._foot(pen, readout)

        ground.paste(layer, (0, 0), layer)
        return np.asarray(ground)

    def _within(self, ground: Any, near: Any) -> None:
        """Insert a picture with a rim into another, at the right."""
        from PIL import ImageOps

        framed = ImageOps.expand(near, round(max(1.0, self._px(2))), fill=_PALE[:3])
        left = self._width - self._px(24) - framed.width
        low = self._height - self._px(104)
        ground.paste(framed, (round(left), round(low - framed.height)))

    def _head(self, pen: Any, readout: PictureText) -> None:
        """Title, phase and time, at the top left."""
        edge = self._px(24)
        row = self._px(18)
        if self._title:
            self._text(pen, (edge, row), self._title, _TITLE, bold=True)
            row += self._px(38)
        self._text(pen, (edge, row), f"{readout.phase}   {readout.time:.1f} s", _TEXT, _PALE)

    def _force(self, pen: Any, readout: PictureText) -> None:
        """Bar of the estimated force with a line at the set force, at the bottom left."""
        left = self._px(24)
        long = self._px(300)
        high = self._px(20)
        top = self._height - self._px(56)
        set_text = f"set {readout.set_force:.0f} N" if readout.set_force else "no force set"
        known = np.isfinite(readout.felt) and readout.set_force > 0.0

        pen.rounded_rectangle((left, top, left + long, top + high), self._px(4), fill=_SHADE)
        if known:
            share = float(np.clip(readout.felt / self._most, 0.0, 1.0))
            pen.rectangle((left, top, left + long * share, top + high), fill=FELT)
        if readout.set_force:
            x = left + long * readout.set_force / self._most
            half = self._px(2)
            pen.rectangle((x - half, top - self._px(5), x + half, top + high + half), fill=SET)

        # Above the bar, in its colours.
        row = top - self._px(34)
        end = self._text(pen, (left, row), set_text, _TEXT, SET if readout.set_force else _PALE)
        if known:
            self._text(pen, (end + self._px(18), row), f"felt {readout.felt:.1f} N", _TEXT, FELT)

    def _foot(self, pen: Any, readout: PictureText) -> None:
        """Current, and the scale of the path's colours, at the bottom right."""
        right = self._width - self._px(24)
        row = self._height - self._px(90)
        if np.isfinite(readout.current):
            water = f"current {readout.current:.2f} m/s"
            self._text(pen, (right, row), water, _TEXT, CURRENT, anchor="ra")

        if self._error is None:
            return
        row += self._px(38)
        words = f"{self._error:g} N"
        left = self._text(pen, (right, row), words, _SMALL, _PALE, anchor="ra")
        left -= self._px(10)
        steps = 24
        for k in range(steps):
            x = left - self._px(120) * (1.0 - k / steps)
            colour = tuple(int(255.0 * c) for c in error_colours(np.array([k / (steps - 1)]))[0])
            low = row + self._px(4)
            pen.rectangle((x, low, x + self._px(120) / steps + 1, low + self._px(13)), fill=colour)
        self._text(pen, (left - self._px(130), row), "force error 0", _SMALL, _PALE, anchor="ra")

    def _text(
        self,
        pen: Any,
        place: tuple[float, float],
        words: str,
        size: float,
        colour: Any = _WHITE,
        *,
        bold: bool = False,
        anchor: str = "la",
    ) -> float:
        """Draw text on a dark plate, and return its end [px] opposite the anchor."""
        font = _font(self._bold if bold else self._plain, max(size * self._scale, _LEAST))
        left, top, right, low = pen.textbbox(place, words, font=font, anchor=anchor)
        rim = self._px(5)
        pen.rectangle((left - rim, top - rim, right + rim, low + rim), fill=_PLATE)
        pen.text(place, words, fill=colour, font=font, anchor=anchor)
        return left if anchor.startswith("r") else right

    def _px(self, length: float) -> float:
        """A length of the usual picture, scaled to this one [px]."""
        return length * self._scale


def error_colours(share: np.ndarray) -> np.ndarray:
    """RGB colours (N, 3), green by yellow to red, of errors (N,) as fractions of full scale."""
    stops = np.array([[0.10, 0.78, 0.45], [0.98, 0.90, 0.25], [0.90, 0.20, 0.10]])
    known = np.clip(share, 0.0, 1.0) * (len(stops) - 1)
    return np.column_stack([np.interp(known, np.arange(len(stops)), c) for c in stops.T])


@cache
def _font(file: str, size: float) -> Any:
    from PIL import ImageFont

    return ImageFont.truetype(file, size)
