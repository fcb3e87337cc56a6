"""Force of the soil on the tool of one plant as a contact force, for the next physics step."""

from typing import NamedTuple, Self

import mujoco
import numpy as np

from uuv.models.site import soil_bed
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.soil_force import press


class SoilContact(NamedTuple):
    """Soil of one plant. Arrays of MuJoCo are views. `numbers` is empty if there is no soil."""

    numbers: Array  # parameters from `uuv.models.site.soil_bed`
    p: Array  # (3,) [m] position of the tool's face, W
    turn: Array  # (9,) axes of the tool, by rows
    state: Array  # (4,) state of the soil, in MuJoCo's activations
    force: Array  # (4,) [N] output: normal force, and force in W

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Self:
        """Soil of a compiled model, if it has any."""
        actuator = soil_bed.actuator_of(model)
        if actuator < 0:
            return cls(np.zeros(0), np.zeros(3), np.zeros(9), np.zeros(soil_bed.STATE), np.zeros(4))

        # Site at the face of the tool, whose actuator holds the state.
        site = int(model.actuator_trnid[actuator, 0])
        first = int(model.actuator_actadr[actuator])
        state = data.act[first : first + soil_bed.STATE]
        return cls(
            soil_bed.numbers_of(model),
            data.site_xpos[site],
            data.site_xmat[site],
            state,
            np.zeros(4),
        )

    def reset(self) -> None:
        """Set the tool to be outside the soil."""
        self.state[:] = self.force[:] = 0.0


@kernel
def feel_soil(soil):
    """Write the force of the next physics step; `soil` is a `SoilContact`, or its fields."""
    numbers, p, turn, state, force = soil
    if numbers.shape[0] == 0:
        return

    axis = np.array([turn[2], turn[5], turn[8]])
    f_W, _ = press(numbers, p, axis, state)

    # Normal force against the tool, and the force in W.
    force[0] = 0.0
    for k in range(3):
        force[0] -= f_W[k] * axis[k]
        force[1 + k] = f_W[k]
