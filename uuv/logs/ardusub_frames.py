"""ArduSub's motor frames, and the assignment of their motors to a vehicle's thrusters.

An autopilot numbers its motors and knows what each does to the vehicle: a factor per axis
[ArduSub frames]. A vehicle's model knows the same from where its thrusters are. The two are matched
by these effects, whatever the thrusters are called; the sign of a match says whether a rising pulse
turns the thruster ahead.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

# Factor of a positive demand on each motor: roll right, pitch up, yaw right, up, forward, right.
FRAMES = {
    "vectored": np.array(
        [
            [0, 0, 1, 0, -1, 1],
            [0, 0, -1, 0, -1, -1],
            [0, 0, -1, 0, 1, 1],
            [0, 0, 1, 0, 1, -1],
            [1, 0, 0, -1, 0, 0],
            [-1, 0, 0, -1, 0, 0],
        ],
        dtype=np.float64,
    ),
    "vectored_6dof": np.array(
        [
            [0, 0, 1, 0, -1, 1],
            [0, 0, -1, 0, -1, -1],
            [0, 0, -1, 0, 1, 1],
            [0, 0, 1, 0, 1, -1],
            [1, -1, 0, -1, 0, 0],
            [-1, -1, 0, -1, 0, 0],
            [1, 1, 0, -1, 0, 0],
            [-1, 1, 0, -1, 0, 0],
        ],
        dtype=np.float64,
    ),
}
FRAME_CONFIGS = {1: "vectored", 2: "vectored_6dof"}  # by the autopilot's parameter
USUAL_VEHICLES = {"vectored": "bluerov2", "vectored_6dof": "bluerov2_heavy"}  # by the frame

# Rows of a wrench in hull axes (forward, port, up) for the axes of the factors, and their signs:
# a pitch up turns about starboard, a yaw to the right about down.
_WRENCH_ROWS = (3, 4, 5, 2, 0, 1)
_WRENCH_SIGNS = np.array([1.0, -1.0, -1.0, 1.0, 1.0, -1.0])
_ALIKE = 0.8  # least cosine between the effects of a motor and its thruster

NEUTRAL = 1500.0  # [us] pulse at which a motor stands still
SPAN = 400.0  # [us] from there to full speed
LEAST_PULSE = 800.0  # [us] below it an output is off
LARGEST_PULSE = 2200.0  # [us] and above it


@dataclass(frozen=True, slots=True, eq=False)
class MotorMap:
    """Motors of an autopilot as thrusters of a vehicle."""

    thrusters: np.ndarray  # (n,) index of each motor's thruster
    signs: Array  # (n,) 1 where a rising pulse turns it ahead, else -1

    @classmethod
    def of(
        cls,
        frame: str,
        wrench_B: Array,
        *,
        directions: Sequence[int] = (),
        vehicle: str = "this vehicle",
    ) -> "MotorMap":
        """Match the motors of a frame with the thrusters of a vehicle.

        Args:
            frame: One of FRAMES.
            wrench_B: (6, m) [-, m] wrench on the hull per newton of each thruster, hull axes.
            directions: MOT_n_DIRECTION of the autopilot, 1 or -1 for each motor: how the real
                thruster is mounted. Empty: all 1.
            vehicle: Its name, for messages.

        Raises:
            ConfigurationError: The frame or a direction is unknown, or the thrusters are not
                arranged so.
        """
        if frame not in FRAMES:
            raise ConfigurationError(f"frame: must be one of {', '.join(FRAMES)}, got {frame!r}")
        factors = FRAMES[frame]

        motors = len(factors)
        thrusters = wrench_B.shape[1]
        if motors != thrusters:
            raise ConfigurationError(
                f"frame {frame}: has {motors} motors, {vehicle} has {thrusters} thrusters"
            )

        turned = np.array(directions or [1] * motors, dtype=np.float64)
        if turned.shape != (motors,) or not np.isin(turned, (-1.0, 1.0)).all():
            raise ConfigurationError(
                f"directions: must be 1 or -1 for each of {motors} motors, got {list(directions)}"
            )

        # Effects per unit, so that levers of centimetres count as much as forces.
        effects = (wrench_B[_WRENCH_ROWS, :] * _WRENCH_SIGNS[:, None]).T
        alike = _normalised(factors) @ _normalised(effects).T
        order, chosen = linear_sum_assignment(-np.abs(alike))
        cosines = alike[order, chosen]

        if np.abs(cosines).min() < _ALIKE:
            worst = int(np.abs(cosines).argmin())
            raise ConfigurationError(
                f"frame {frame}: no thruster of {vehicle} acts as motor {worst + 1} "
                f"(cosine {abs(cosines[worst]):.2f}, at least {_ALIKE})"
            )
        return cls(chosen, np.sign(cosines) * turned)

    def commands(self, pulses: Array) -> Array:
        """Commands (m,) in [-1, 1] of the vehicle's thrusters at pulses [us] of the channels.

        Motor n is on channel n. A pulse that no speed controller takes, 0 first of all, stops it.
        """
        of_motors = pulses[: len(self.thrusters)]
        valid = (of_motors >= LEAST_PULSE) & (of_motors <= LARGEST_PULSE)
        speeds = np.clip((of_motors - NEUTRAL) / SPAN, -1.0, 1.0)

        commands = np.zeros(len(self.thrusters))
        commands[self.thrusters] = self.signs * np.where(valid, speeds, 0.0)
        return commands


def _normalised(effects: Array) -> Array:
    """Rows of unit length after each column was divided by its largest entry."""
    largest = np.abs(effects).max(axis=0)
    scaled = effects / np.where(largest > 1e-9, largest, np.inf)
    lengths = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(lengths > 0.0, lengths, 1.0)
