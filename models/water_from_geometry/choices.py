"""What a user can choose of a model's water: the geoms that displace it, and the number of
panels.
"""

from typing import Final, Literal, get_args

Choice = Literal["auto", "visual", "collision", "all"]
CHOICES: Final[tuple[Choice, ...]] = get_args(Choice)
PANELS: Final = 1600  # of each body
FEWEST_PANELS: Final = 400  # a quarter of them must still show the body
MOST_PANELS: Final = 6400  # a surface may get a quarter more than was wanted
