"""The plant: a motion that blows up is said, and does not begin anew behind one's back."""

import numpy as np
import pytest

import models
from sim import hydrodynamics
from sim.current import Current
from sim.interfaces.errors import HydrodynamicsError
from sim.interfaces.messages import Command
from sim.plant import Plant


def advance(plant: Plant, steps: int) -> None:
    rest = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)
    for _ in range(steps):
        plant.step(rest)
        plant.observe()


@pytest.mark.parametrize("steps", [0, 1, 50])
@pytest.mark.parametrize("speed", [np.nan, 1e12])
def test_a_motion_that_blows_up_is_an_error(steps, speed):
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=Current((0.0, 0.0, 0.0)))
    plant.observe()
    advance(plant, steps)
    plant.data.qvel[3] = speed
    with pytest.raises(HydrodynamicsError, match=r"became unstable .* 'hull'"):
        advance(plant, 5)
