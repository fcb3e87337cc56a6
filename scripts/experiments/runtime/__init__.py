"""Cost: loop, physics, engines, and the list of kernels of a first start."""
