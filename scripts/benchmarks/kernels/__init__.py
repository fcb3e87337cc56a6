"""List of the kernels that a job compiles."""
