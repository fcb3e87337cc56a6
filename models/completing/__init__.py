"""What a user's vehicle lacks and can be given: names, postures, camera, hull box, mounting of an
arm.
"""
