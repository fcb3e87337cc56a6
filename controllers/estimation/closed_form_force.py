"""Tip force from the torques of joints 1, 3 and 4 alone, as published [Konoplin 2022, eq. 5].

A pure force on the tip has three unknowns, which three joints determine: three rows of J^T f =
tau_e. On the arm of the paper, a yaw joint and three parallel pitch joints with joints 5 and 6 at
zero, the solution is the published closed form (`force_from_torques.tip_force_closed_form`). Least
squares over all joints (`TorqueSensors`) is more accurate.
"""

import numpy as np

from uuv.controllers.estimation.tip_force_estimator import ContactState, DriveState, TorqueSensors
from uuv.controllers.estimation.tip_force_kernels import PRIOR
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import ContactEstimate, Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array

JOINTS = (0, 2, 3)  # 1, 3 and 4 in the paper's count
# [-] ratio of the least to the largest singular value of the three rows, below which the force is
# held
_SINGULAR = 0.02


class ClosedFormForce(TorqueSensors):
    """Contact force from joints 1, 3 and 4.

    Near a singular posture of the three joints (q4 = 0 on the arm of the paper, or the tip over the
    yaw axis) the last force is kept.
    """

    def init(self, estimate: StateEstimate) -> ContactState:
        """Initial state: free of contact.

        Raises:
            ConfigurationError: The arm has fewer than four joints.
        """
        if len(estimate.q) <= max(JOINTS):
            raise ConfigurationError(
                "closed form of the tip force: the arm must have at least 4 joints, since joints "
                f"1, 3 and 4 are used; got {len(estimate.q)}"
            )
        return super().init(estimate)

    def sense(self, state: ContactState, estimate: StateEstimate, drives: DriveState) -> None:
        """Force, friction and motion of one sample, without tare and payload.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: present estimate of the vehicle.
            drives: last commands of the drives.
        """
        before_B = state.sensed.f_B.copy()
        super().sense(state, estimate, drives)
        sensed = state.sensed
        rows = list(JOINTS)
        now_B = before_B

        A = sensed.J_B[:3, rows].T
        if _regular(A):
            now_B = np.linalg.solve(A, (sensed.tau_e - state.bias)[rows])

        sensed.f_B[:] = before_B + self._force_share * (now_B - before_B)
        sensed.f_G[:] = sensed.X_BG[:3, :3].T @ sensed.f_B

        state.estimate = ContactEstimate(
            force_W=estimate.X_WB[:3, :3] @ sensed.f_B,
            normal=float(-sensed.f_G[2]),
            sigma_G=state.record.sigma_G,
        )

    def follow_up(self, state: ContactState, estimate: StateEstimate, reference: Reference) -> None:
        """Rest of a slow step after `sense` and tare: payload and sigma.

        Args:
            state: as `sense` left it; changed in place.
            estimate: present estimate of the vehicle.
            reference: shows when the arm begins its work.
        """
        if state.record.weighing[0]:
            self.weigh(state, estimate, reference)

        noise = self.gains.noise * np.abs(estimate.tau)
        variance = self.gains.kept * noise**2 + self.gains.drift**2
        state.record.sigma_G[:] = self._sigma_G(state, variance)

    def _sigma_G(self, state: ContactState, variance: Array) -> Array:
        rows = list(JOINTS)
        A = state.sensed.J_B[:3, rows].T @ state.sensed.X_BG[:3, :3]
        if not _regular(A):
            return np.full(3, PRIOR**-0.5)
        return np.sqrt(np.linalg.inv(A) ** 2 @ variance[rows])


def _regular(A: Array) -> bool:
    singular = np.linalg.svd(A, compute_uv=False)
    return bool(singular[-1] > _SINGULAR * singular[0])
