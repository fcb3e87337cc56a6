"""Work on the seabed: terrains and speed."""
