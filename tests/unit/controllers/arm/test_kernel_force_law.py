"""Force law from a function of one's own: its displacement by hand, its memory, and what is
refused.
"""

import numpy as np
import pytest

from uuv.controllers.arm.kernel_force_law import KernelForceLaw
from uuv.controllers.arm.position_force import ForceDisplacement
from uuv.sim.interfaces.errors import ConfigurationError

DT = 0.004  # [s]


def integrate(memory, set_force, felt, _servo_compliance, dt):
    memory[0] += 1e-4 * (set_force - felt) * dt
    memory[1] += 1.0
    return memory[0]


def leap(_memory, set_force, _felt, _servo_compliance, _dt):
    return set_force


def test_displacement_is_the_law_s():
    law = KernelForceLaw(law=integrate, numbers=2)
    state = law.init()
    k = 0.0
    for felt in np.linspace(0.0, 80.0, 50):
        k += 1e-4 * (60.0 - felt) * DT
        assert law.step(state, 60.0, float(felt), 1e-5, DT) == pytest.approx(k, rel=1e-15)
    assert state.k == pytest.approx(k, rel=1e-15)


def test_memory_is_zero_whenever_the_loop_closes():
    law = KernelForceLaw(law=integrate, numbers=2)
    state = law.init()
    for _ in range(3):
        law.step(state, 60.0, 0.0, 1e-5, DT)
    assert state.numbers[-1] == 3.0
    law.release(state, DT)
    law.step(state, 60.0, 0.0, 1e-5, DT)
    assert state.numbers[-1] == 1.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_displacement_is_limited_and_released_as_the_default_one(sign):
    law = KernelForceLaw(law=leap)
    usual = ForceDisplacement()
    state = law.init()
    assert law.step(state, sign, 0.0, 1e-5, DT) == pytest.approx(sign * law.speed * DT)
    for _ in range(1000):
        law.step(state, sign, 0.0, 1e-5, DT)
    assert state.k == pytest.approx(sign * law.limit)
    other = usual.init()
    other.k = state.k
    for _ in range(3):
        assert law.release(state, DT) == usual.release(other, DT)


def test_what_numba_cannot_compile_is_refused_in_one_line():
    def opens(*_):
        return float(open("a file").read())

    with pytest.raises(
        ConfigurationError,
        match=r"^force law opens: numba cannot compile the function: "
        r".*'open'[^\n]*$",
    ):
        KernelForceLaw(law=opens)
    with pytest.raises(ConfigurationError, match="at least 1, got 0"):
        KernelForceLaw(law=leap, numbers=0)
