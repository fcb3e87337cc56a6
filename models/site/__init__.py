"""Work sites: scenes of vehicle, object and seabed; terrains; soils."""
