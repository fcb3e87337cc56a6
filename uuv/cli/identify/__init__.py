"""Verbs that identify: an object in a cloud, the friction of an arm, the water of a vehicle."""
