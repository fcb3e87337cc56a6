"""Verbs for runs with another program or an operator: serve ardupilot, serve udp, drive."""
