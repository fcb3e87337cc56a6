"""Results: kept rows of experiments, checked against the present code, and pages made of them."""
