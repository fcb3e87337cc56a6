"""Colours and sizes that all figures share."""

# Palette [Okabe 2008]: distinguishable for colour-blind readers, in print and on a dark background.
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
)
YELLOW = "#F0E442"
INK, FAINT = "#222222", "#888888"
CYCLE = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, INK, FAINT)
WIDTH = 10.0  # [in] width of a figure


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of #RRGGBB."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
