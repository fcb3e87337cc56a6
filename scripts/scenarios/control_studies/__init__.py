"""Studies of single parts of the control stack: cases, one run, summary."""
