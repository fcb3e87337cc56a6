"""Options for hydrodynamics from geometry: geoms that displace water, and number of panels."""

from typing import Final, Literal, get_args

Choice = Literal["auto", "visual", "collision", "all"]
CHOICES: Final[tuple[Choice, ...]] = get_args(Choice)
PANELS: Final = 1600  # number of panels of each body
FEWEST_PANELS: Final = 400  # least number of panels: a quarter of them must still describe the body
# largest number of panels: a surface may have a quarter more than was asked for
MOST_PANELS: Final = 6400
