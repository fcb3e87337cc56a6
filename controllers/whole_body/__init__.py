"""Controllers of hull and arm together, and their tick at the rate of the drives."""
