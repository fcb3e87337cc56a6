"""Identification of a vehicle's water from logs: replay on our model, manoeuvres, command and
study.
"""
