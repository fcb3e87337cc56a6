"""Other people's code behind one kind of call, for the benchmarks alone."""
