"""The published identification, for comparison: its ICP and its check [Konoplin 2022]."""
