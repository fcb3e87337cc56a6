"""Where the work is: scenes of vehicle, object and seabed; terrains; soils."""
