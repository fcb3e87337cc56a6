"""Components of a loop: sensors, controller and models of a scenario, and the arm's calibration on
deck.
"""
