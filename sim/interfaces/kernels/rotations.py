"""Rotations in compiled code, by the functions of `uuv.sim.interfaces.spatial` themselves."""

from uuv.sim.interfaces import spatial
from uuv.sim.interfaces.kernels.stored import kernel

_quaternion_of = kernel(spatial.quaternion_of)
_vector_of = kernel(spatial.rotation_vector_of)


@kernel
def log_of_rotation(R):
    """Rotation vector (three numbers) [rad] of `R` (3, 3), the same as `spatial.log_so3`."""
    rows = (R[0, 0], R[0, 1], R[0, 2]), (R[1, 0], R[1, 1], R[1, 2]), (R[2, 0], R[2, 1], R[2, 2])
    return _vector_of(_quaternion_of(rows))
