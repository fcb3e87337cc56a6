"""Pool trials of a BlueROV2 with a Reach Alpha arm beside our simulation of them: read, replay,
fit, compare.
"""
