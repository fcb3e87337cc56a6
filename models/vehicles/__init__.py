"""Named vehicles and arms, with the source of every figure."""
