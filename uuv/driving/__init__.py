"""Driving: a job's site with an operator in place of its planner, by file or keyboard."""
