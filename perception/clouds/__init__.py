"""Clouds: point clouds from files and frames on one pixel grid, cleaned and segmented."""
