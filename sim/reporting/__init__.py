"""Reports, pictures, terminal tables, and visual logs for Rerun."""
