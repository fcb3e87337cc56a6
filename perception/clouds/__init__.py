"""Point clouds: from files and frames to one pixel grid, segmented and cleaned."""
