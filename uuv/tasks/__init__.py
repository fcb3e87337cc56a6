"""Tasks of a scenario: what is to be done at a site, and how it is planned and judged there."""
