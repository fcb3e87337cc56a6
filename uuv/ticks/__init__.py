"""Compiled ticks of the loop: with the default controller, and around any other."""
