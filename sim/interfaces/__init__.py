"""Shared base of all packages: spatial algebra, messages, protocols, errors. Imports numpy only, but for `kernels`."""
