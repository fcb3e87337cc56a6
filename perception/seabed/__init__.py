"""Seabed: surface of an unknown seabed, and tool paths over it."""
