"""Feedforward: what of the arm's wrench on the hull is fed forward to the thrusters.

[Konoplin 2022] feeds C_F = C_D + A f_e forward to the thrusters: the wrench of the arm's motion in
water, and that of the contact. `WithoutTerms` and `WithoutCompensation` leave parts of it out, for
a study.
"""

from collections.abc import Set
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Protocol

import numpy as np
from numba.np.numpy_support import carray

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.wrench_terms import WrenchTerms
from uuv.controllers.estimation.tip_force_estimator import ContactState
from uuv.sim.interfaces.kernels.slots import FINE, Slot, empty_slot, slot_function
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array

Term = Literal["hydrodynamic", "dynamic", "contact"]

# Entries of the values of a slot for a feedforward: wrenches (6,) [N, N m] of `ArmLoad`, and the
# answer, what is left out
CONTACT_B, WRENCH_B, LEFT_OUT_B = 0, 6, 12
FEEDFORWARD_VALUES = 3 * 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmLoad:
    """Wrench (6,) [N, N m] of the arm on the hull, at the hull's origin in hull axes."""

    contact_B: Array  # part of the contact; zero while free of contact
    wrench_B: Array  # all of it


class Feedforward(Protocol):
    """Choice of what is fed forward."""

    def left_out(
        self, load: ArmLoad, contact: ContactState, estimate: StateEstimate
    ) -> Array | None:
        """Part (6,) [N, N m] of the arm's wrench that is not fed forward, hull axes; None: nothing.

        Args:
            load: the arm's wrench on the hull.
            contact: motion of arm and hull.
            estimate: of the vehicle now.
        """
        ...


class ArmWrench:
    """Feed all of the arm's wrench forward."""

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> None:
        """Nothing is left out."""

    def slot(self, state: None) -> Slot:
        """It is contained in the tick."""
        return empty_slot(state, FEEDFORWARD_VALUES)


class WithoutCompensation:
    """Feed only the weight of the arm at home forward, whatever it does."""

    def __init__(self, arm: ArmDynamics, q_home: Array) -> None:
        self._home_wrench = arm.wrench_at_rest(np.array(q_home))

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> Array:
        """Everything but the wrench at home."""
        return load.wrench_B - self._home_wrench

    def slot(self, state: None) -> Slot:
        """The same as a kernel, whose memory is the wrench at home."""
        return Slot(_all_but().address, self._home_wrench, np.zeros(FEEDFORWARD_VALUES))


@cache
def _all_but() -> Any:
    def leave_out(memory: Any, values: Any) -> int:
        kept_B = carray(memory, 6)
        wrenches_B = carray(values, FEEDFORWARD_VALUES)
        wrenches_B[LEFT_OUT_B:] = wrenches_B[WRENCH_B:LEFT_OUT_B] - kept_B
        return FINE

    return slot_function(leave_out)


class WithoutTerms:
    """Feed the arm's wrench forward without some of its terms."""

    def __init__(
        self, arm: ArmDynamics, terms: Set[Term], *, acceleration_filter: float, period: float
    ) -> None:
        """Choose the terms.

        Args:
            arm: believed dynamics of the arm.
            terms: those to leave out.
            acceleration_filter: [s] of the joint acceleration in the contact estimator.
            period: [s] of its steps.
        """
        self._terms = WrenchTerms(arm)
        self._without = frozenset(terms)
        self._lag = max(acceleration_filter - period, period)

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> Array:
        """Sum of the terms."""
        left_out = load.contact_B.copy() if "contact" in self._without else np.zeros(6)
        q = estimate.q
        qd = estimate.qd
        sensed = contact.sensed
        qdd = (qd - sensed.qd_slow) / self._lag  # the estimator has moved qd_slow on by one period
        if "hydrodynamic" in self._without:
            left_out += self._terms.hydrodynamic(sensed.hull, q, qd, qdd)
        if "dynamic" in self._without:
            left_out += self._terms.dynamic(sensed.hull, q, qd, qdd)

        return left_out
