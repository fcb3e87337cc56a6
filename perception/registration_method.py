"""Methods of registration by name."""

from typing import Literal

# For comparison: "paper" as published, "paper-scan" with its pairs from scan to model, which the
# paper leaves open, "paper-q" with the published threshold on its quality Q.
Method = Literal["planes", "paper", "paper-scan", "paper-q"]
