"""Tasks of a scenario: what is to be done at a site, and how plant, finder, planner and evaluation are made for it."""
