"""Tasks of a hand: an object is grasped, a valve turned."""
