"""Controllers: state estimates and references to commands."""

import sim.interfaces  # noqa: F401  sets the folder in which compiled loops are cached
