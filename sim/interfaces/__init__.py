"""Shared base of all packages: spatial algebra, messages, protocols, documents, pages, errors.
Imports numpy only.

`kernels` also imports numba. `documents` imports the package of a format when it reads or writes a
file.
"""
