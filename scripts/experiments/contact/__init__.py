"""Contact work: seas, faults, waves, force steps, and the force estimated at the tip."""
