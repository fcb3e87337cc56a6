"""Registration: pose of a known object by ICP, with verification of the result."""
