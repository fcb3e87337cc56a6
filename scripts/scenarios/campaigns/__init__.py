"""Many runs: what is drawn for each, the pool that does them, their statistics and pages."""
