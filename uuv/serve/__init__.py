"""Doors for other programs: a vehicle in the water that they drive over a socket."""
