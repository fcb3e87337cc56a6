"""A gripper's readings as a part of the state: the newest one, beside the wrapped estimate."""

import numpy as np

from uuv.perception.navigation.jaw_readings import JawReadings
from uuv.perception.navigation.raw_navigation import RawNavigation
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    JawMeasurement,
    TorqueMeasurement,
    VisionMeasurement,
)
from uuv.sim.interfaces.spatial import exp_so3


def test_the_newest_reading_stands_in_the_estimate_until_another_comes() -> None:
    R_WB = exp_so3([0.1, -0.2, 0.7])
    first = [
        EncoderMeasurement(time=0.0, q=np.arange(6.0), qd=np.zeros(6)),
        TorqueMeasurement(time=0.0, tau=np.ones(6)),
        ImuMeasurement(
            time=0.0, specific_force_B=R_WB.T @ [0, 0, 9.8], w_WB_B=np.zeros(3), R_WB=R_WB
        ),
        DvlMeasurement(time=0.0, v_WB_B=np.array([0.1, 0.0, 0.2])),
        VisionMeasurement(time=0.0, p_WB=np.array([1.0, -2.0, 3.0])),
    ]
    estimator = JawReadings(RawNavigation())
    state = estimator.init(first)
    state, estimate = estimator.step(state, first)
    assert estimate.jaws is None
    assert np.allclose(estimate.X_WB[:3, 3], [1.0, -2.0, 3.0])

    readings = [
        JawMeasurement(time=time, opening=0.05 - time, speed=-1.0, force=3.0)
        for time in (0.01, 0.02)
    ]
    state, estimate = estimator.step(state, readings)
    assert estimate.jaws is readings[1]
    _, estimate = estimator.step(state, [])
    assert estimate.jaws is readings[1]
    assert np.allclose(estimate.q, np.arange(6.0))
