"""Bandwidth of the joint servo on a hull that gives way to the arm.

The servo computes its torques with the inertia M of the arm on a hull that is held. A free hull
gives way, and the joints feel less: with the inertia H of hull and arm and their coupling C to the
joints, M - C^T H^-1 C. Along its worst direction the servo's damping is then larger than intended
by the ratio of the two. With the period T of the drives, the gain of the joint speed in a sample is
2 zeta w T times this ratio. Above 2, and earlier with the lags of the loop, the speed overshoots in
each sample: the joints chatter at half the rate of the drives. The servo of an arm that is heavy
for its hull is slowed down to a gain at which arms have been found to be steady.
"""

from dataclasses import replace

import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.station_keeping import arm_inertia
from uuv.controllers.tuning import ArmTuning
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import Array

# [-] largest gain of the joint speed in one period, 2 zeta w T times the ratio. In contact, arms
# are steady at 0.85 (BlueROV2 with Reach Alpha) and chatter at 1.35 (Girona 500).
MOST_GAIN = 0.9


def yielding_ratio(arm: ArmDynamics, of_hull: Array, armature: Array, q: Array) -> float:
    """Largest ratio [-] of the arm's inertia on a hull that is held to that on the free hull.

    Args:
        arm: the arm.
        of_hull: (6, 6) inertia of the hull alone with its added mass, hull axes at its origin.
        armature: (n,) [kg m^2] rotor inertias at the joints.
        q: (n,) [rad] joint angles.
    """
    rest = np.zeros(arm.n)
    still = np.zeros(6)

    def torque(a_B: Array) -> Array:
        tau, _ = arm.inverse(
            q,
            rest,
            rest,
            R_WB=np.eye(3),
            nu_B=still,
            a_B=a_B,
            v_current_W=np.zeros(3),
            wrench_tip_G=still,
        )
        return tau

    # Coupling (n, 6): joint torques per acceleration of the hull
    coupling = np.column_stack([torque(unit) for unit in np.eye(6)]) - torque(still)[:, None]
    whole = of_hull + arm_inertia(arm, q)
    held = arm.inertia(q) + np.diag(armature)
    free = held - coupling @ np.linalg.solve(whole, coupling.T)
    return float(np.linalg.eigvals(np.linalg.solve(free, held)).real.max())


def slowed_down(
    tuning: ArmTuning, arm: ArmDynamics, of_hull: Array, vehicle: Vehicle, period: float
) -> ArmTuning:
    """`tuning`, with a lower bandwidth of the joint servo where the hull is light for its arm.

    Args:
        tuning: gains of the arm.
        arm: the arm.
        of_hull: (6, 6) inertia of the hull alone with its added mass, hull axes at its origin.
        vehicle: the vehicle; its arm is judged at home, ready, and with its joints in mid range.
        period: [s] of the servo.
    """
    postures = vehicle.q_home, vehicle.q_ready, vehicle.q_limits.mean(axis=1)
    ratio = max(
        yielding_ratio(arm, of_hull, vehicle.armature, np.array(posture)) for posture in postures
    )

    gain = 2.0 * tuning.joint_damping * tuning.joint_frequency * period * ratio
    if not gain > MOST_GAIN:
        return tuning
    return replace(tuning, joint_frequency=tuning.joint_frequency * MOST_GAIN / gain)
