"""Results: kept rows of experiments, checked with the present code, and pages made from them."""
