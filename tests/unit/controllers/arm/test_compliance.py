"""Lateral compliance against its differential equation, its bounds, and what it must not answer
to.
"""

import numpy as np
import pytest

from uuv.controllers.arm.compliance import ComplianceState, LateralCompliance
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3

DT = 0.004  # [s]
LAW = LateralCompliance()


def against_wall(
    law: LateralCompliance, stiffness: float, depth: float, z: np.ndarray, seconds: float
) -> np.ndarray:
    """Offsets (N,) [m] along the wall's normal of a tool that was moved `depth` [m] into a wall
    along its side.
    """
    out = np.cross(z, [0.3, -0.5, 0.8])
    out /= np.linalg.norm(out)
    state = ComplianceState()
    offsets = []
    for _ in range(round(seconds / DT)):
        force = stiffness * max(0.0, depth - float(state.offset_W @ out)) * out
        offsets.append(float(law.step(state, force, z, DT) @ out))
    return np.array(offsets)


@pytest.mark.parametrize("stiffness", [1e4, 3e4])
def test_a_wall_is_given_way_to_as_the_equation_says(stiffness, within):
    """o' = A (K (d - o) - b) has o = (d - b / K) (1 - exp(-K A t)); Euler's step errs by K A dt / 2
    of it at most.
    """
    z = exp_so3([0.3, -0.4, 0.2]) @ [0.0, 0.0, -1.0]
    depth = 0.5e-3
    law = LateralCompliance(speed=1.0)
    offsets = against_wall(law, stiffness, depth, z, 3.0)
    t = DT * np.arange(1, len(offsets) + 1)
    rest = depth - law.dead_band / stiffness
    exact = rest * (1.0 - np.exp(-stiffness * law.admittance * t))
    within("offset, relative", (offsets - exact) / rest, 0.5 * stiffness * law.admittance * DT)
    within("force left [N]", stiffness * (depth - offsets[-1]) - law.dead_band, 1e-3)


def test_only_the_force_across_the_axis_moves_it(within):
    rng = np.random.default_rng(3)
    z = rng.normal(size=3)
    z /= np.linalg.norm(z)
    state = ComplianceState()
    LAW.step(state, 80.0 * z, z, DT)
    assert not state.offset_W.any()
    LAW.step(state, 80.0 * z + 0.99 * LAW.dead_band * np.cross(z, [1.0, 0.0, 0.0]), z, DT)
    assert not state.offset_W.any()
    LAW.step(state, 80.0 * z + rng.normal(scale=20.0, size=3), z, DT)
    assert np.linalg.norm(state.offset_W) > 0.0
    within("offset along the axis [m]", state.offset_W @ z, 1e-18)


def test_speed_place_and_the_way_back_are_bounded(within):
    z = np.array([0.0, 0.0, 1.0])
    state = ComplianceState()
    way = [np.linalg.norm(LAW.step(state, np.array([500.0, 0.0, 0.0]), z, DT)) for _ in range(1000)]
    within("speed over its bound", max(np.diff(way)) / DT - LAW.speed, 1e-12)
    assert way[-1] == pytest.approx(LAW.limit)
    # Nothing was wound up: a force the other way moves it at once.
    before = state.offset_W.copy()
    LAW.step(state, np.array([-10.0, 0.0, 0.0]), z, DT)
    assert before[0] - state.offset_W[0] == pytest.approx(
        LAW.admittance * (10.0 - LAW.dead_band) * DT
    )
    steps = 0
    while np.linalg.norm(LAW.release(state, DT)) > 0.0:
        steps += 1
    assert steps * DT == pytest.approx(LAW.limit / LAW.release_speed, rel=0.02)


def test_a_tool_that_stands_yields_and_returns_gently(within):
    z = np.array([0.0, 0.0, 1.0])
    force = np.array([500.0, 0.0, 0.0])
    state = ComplianceState()
    way = [np.linalg.norm(LAW.step(state, force, z, DT, gently=True)) for _ in range(200)]
    within("speed over its bound", max(np.diff(way)) / DT - LAW.gentle_speed, 1e-12)
    assert LAW.gentle_speed < LAW.speed
    back = [np.linalg.norm(LAW.release(state, DT)) for _ in range(100)]
    within("speed back over its bound", max(-np.diff(back)) / DT - LAW.gentle_speed, 1e-12)
    # One that yields at full speed again, as in a hole, also returns at full speed.
    LAW.step(state, force, z, DT)
    before = np.linalg.norm(state.offset_W)
    assert before - np.linalg.norm(LAW.release(state, DT)) == pytest.approx(LAW.release_speed * DT)
    # A speed below the gentle one holds in both cases.
    slow = LateralCompliance(speed=0.002)
    gentle = ComplianceState()
    slow.step(gentle, force, z, DT, gently=True)
    assert np.linalg.norm(gentle.offset_W) == pytest.approx(0.002 * DT)


def test_the_loop_with_its_lags_is_stable_at_the_stiffness_of_the_mount():
    """Filter and servo as the docstring of the law has them: it settles at 3e4 N/m without swinging
    far, not at 3e5.
    """

    def largest(stiffness: float) -> tuple[float, float]:
        state = ComplianceState()
        z = np.array([0.0, 0.0, 1.0])
        dt = 1e-3
        law = LateralCompliance(speed=10.0, limit=1.0, dead_band=0.0)
        w, x, v, felt, over = 60.0, 0.0, 0.0, 0.0, 0.0
        for step in range(4000):
            force = stiffness * (1e-3 - x)
            felt += dt / 0.012 * (force - felt)
            if step % 4 == 0:
                law.step(state, np.array([felt, 0.0, 0.0]), z, DT)
            v += dt * (w * w * (state.offset_W[0] - x) - 2.0 * w * v)
            x += dt * v
            over = max(over, x / 1e-3 - 1.0)
        return over, abs(x / 1e-3 - 1.0)

    over, left = largest(3e4)
    assert over < 0.2
    assert left < 1e-3
    assert largest(3e5)[1] > 1.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"admittance": 0.0}, "admittance"),
        ({"limit": float("nan")}, "limit"),
        ({"dead_band": -1.0}, "dead_band"),
    ],
)
def test_what_cannot_be_is_refused(change, said):
    with pytest.raises(ConfigurationError, match=said):
        LateralCompliance(**change)
