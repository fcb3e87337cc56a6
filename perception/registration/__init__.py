"""Identification: where a known object is, by ICP, with a check of the result."""
