"""Shared base of all packages: spatial algebra, messages, protocols, documents, pages, errors.
Imports numpy only.

`kernels` imports numba too, and `documents` the package of a format when a file is read or written.
"""
