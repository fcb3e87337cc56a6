"""Colours and sizes that all figures share, and the plain look of their axes."""

from typing import Any

# Palette [Okabe 2008]: distinguishable for colour-blind readers, in print and on a dark background.
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
YELLOW = "#F0E442"
INK = "#222222"
FAINT = "#888888"
CYCLE = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, INK, FAINT)
GRID = "#e6e6e6"
WIDTH = 10.0  # [in] width of a figure


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of #RRGGBB."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def plain_axes(axes: Any, labels: float | None = None) -> None:
    """Remove the frame of Matplotlib's `axes`, and draw a pale grid behind their content.

    Args:
        axes: The axes.
        labels: [pt] Size of the numbers; None leaves it unchanged.
    """
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    if labels is not None:
        axes.tick_params(labelsize=labels)
