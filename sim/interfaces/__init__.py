"""Shared base of all packages: spatial algebra, messages, protocols, errors. Imports numpy only."""

from sim.interfaces import kernel_cache

kernel_cache.prepare()  # before any kernel is compiled, whichever package is imported first
