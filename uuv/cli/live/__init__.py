"""Verbs on a run that goes on with others: serve ardupilot, serve udp, drive."""
