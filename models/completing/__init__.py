"""Missing parts of a user's vehicle, added: names, postures, camera, hull box, and an arm mounted
on it.
"""
