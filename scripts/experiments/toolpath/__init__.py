"""Tool paths on surfaces that are fouled or dented."""
