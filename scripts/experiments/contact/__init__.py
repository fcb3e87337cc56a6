"""Contact work: steps of the force, and the force estimated at the tip; its campaigns are files."""
