"""Finding the object: identification in frames, survey, tracking, and choice of the next view."""
