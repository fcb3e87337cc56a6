"""Methods of registration by name."""

from typing import Literal

# "paper" for comparison, as published; "paper-q" with the published threshold on its quality Q too.
Method = Literal["planes", "paper", "paper-q"]
