"""The leaf that every room may import: spatial algebra, messages, protocols, errors. Imports numpy only."""

from sim.interfaces import kernel_cache

kernel_cache.prepare()  # before any loop is compiled, whichever room is imported first
