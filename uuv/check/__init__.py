"""Check of a vehicle: its parts, figures and doubts, and what each job says of it before it is
run.
"""
