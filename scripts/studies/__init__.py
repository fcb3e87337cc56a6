"""Studies: each command repeats a job over many random draws and reports the spread of its figures."""
