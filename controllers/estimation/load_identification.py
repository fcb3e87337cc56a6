"""Load identification: mass and centre of what the jaws hold, from the torques of the arm at rest.

The load is represented by four point masses at the corners of a tetrahedron about the place where
its middle is expected. They may be negative, so that their sum is the mass less the displaced
water, and their first moment is that of the load. They are the parts of a
`uuv.controllers.estimation.payload_identification.PayloadIdentification`. Its priors leave the sum
free and keep the centre near its expected place: in one posture its height has no effect.
"""

import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics, JointMotion
from uuv.controllers.estimation.payload_identification import PayloadIdentification, in_vacuum
from uuv.sim.interfaces.messages import HeldLoad
from uuv.sim.interfaces.spatial import Array, readonly

_CORNERS = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
# [m] of a corner along each axis: the prior of the first moment about the expected centre is twice
# this times the spread, 0.02 kg m
_REACH = 1e-3
_SPREAD = 10.0  # [kg] prior of a point mass
_BIAS = 0.02  # [N m] prior of a torque's error since the tare, that differs from joint to joint


class LoadIdentification:
    """Least squares of the load in the jaws, with its samples."""

    def __init__(self, arm: ArmDynamics, expected: HeldLoad, doubt: Array) -> None:
        """Begin without a sample.

        Args:
            arm: modelled dynamics of the arm without the load.
            expected: where the load's middle is, and the water that it displaces.
            doubt: (n,) [N m] standard deviation of each torque.
        """
        self._expected = expected
        self._points_G = expected.buoyancy_G + _REACH * _CORNERS

        # The arm without any mass but that of one point.
        empty = in_vacuum(arm)
        for masses in arm.of_bodies(empty, "mass", "inertia"):
            masses[:] = 0.0
        points = [
            HeldLoad(mass=1.0, displaced=0.0, center_G=point, buoyancy_G=point)
            for point in self._points_G
        ]
        parts = np.stack([arm.with_load(empty, point) for point in points])
        self._least_squares = PayloadIdentification(
            arm, parts=parts, spread=_SPREAD, bias=_BIAS, doubt=doubt
        )
        self._state = self._least_squares.init()

    def add(self, joints: JointMotion, hull: Array, tau_e: Array) -> None:
        """Add a sample, free of contact but for the load.

        Args:
            joints: motion of the joints.
            hull: (24,) motion of the hull as in `newton_euler`.
            tau_e: (n,) [N m] torques of the arm's model less the measured ones and their tare.
        """
        self._least_squares.add(self._state, joints, hull, tau_e)

    @property
    def load(self) -> HeldLoad:
        """The load from all samples."""
        expected = self._expected
        net = self._least_squares.excess(self._state)
        mass = max(float(net.sum()) + expected.displaced, 0.0)

        # What is as heavy as its water turns about its middle.
        moment = net @ self._points_G + expected.displaced * expected.buoyancy_G
        center_G = moment / mass if mass > 0.0 else expected.buoyancy_G
        return HeldLoad(
            mass=mass,
            displaced=expected.displaced,
            center_G=readonly(center_G),
            buoyancy_G=expected.buoyancy_G,
            radius=expected.radius,
        )
