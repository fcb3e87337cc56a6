"""Methods of registration by name."""

from typing import Literal

# "paper": as published, for comparison; "paper-q": also with the published threshold on its quality
# Q.
Method = Literal["planes", "paper", "paper-q"]
