"""The published identification, for comparison: its ICP and its check of the fit [Konoplin
2022].
"""
