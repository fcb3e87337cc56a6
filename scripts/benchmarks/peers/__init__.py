"""Third-party solvers and simulators behind common interfaces, for the benchmarks only."""
