"""Reports, figures, terminal tables, and visual logs for Rerun."""
