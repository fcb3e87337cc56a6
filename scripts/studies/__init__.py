"""Studies: each a command that repeats a job over many draws and says how its figures spread."""
