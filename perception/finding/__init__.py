"""Where the object is: found in frames, surveyed, tracked, and the next view of it."""
