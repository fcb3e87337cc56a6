"""Water of a model from its geometry: volume, centre of buoyancy, added mass and drag of URDF, MJCF
and meshes.
"""
