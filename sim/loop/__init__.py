"""The step loop of a run, and the recording of it."""
