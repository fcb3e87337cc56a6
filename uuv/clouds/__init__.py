"""Commands on point clouds: options, reports and pictures of identification, deformation map and
seabed path.
"""
