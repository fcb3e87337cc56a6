"""Check of a vehicle: its parts, figures and doubts, and the verdict of each job before it runs."""
