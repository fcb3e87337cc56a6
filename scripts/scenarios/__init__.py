"""The scenario layer: wires the rooms together into runs. Nothing else may."""
