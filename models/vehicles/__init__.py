"""The named vehicles and arms, each with the source of every figure."""
