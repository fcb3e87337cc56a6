"""Feedforward of the arm's wrench on the hull to the thrusters, all of it or only some terms.

[Konoplin 2022] feeds C_F = C_D + A f_e forward to the thrusters: the wrench of the arm's motion in
water, and that of the contact. `WithoutTerms` and `WithoutCompensation` leave out parts of this
wrench, for studies.
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
# result, the part left out
CONTACT_B, WRENCH_B, LEFT_OUT_B = 0, 6, 12
FEEDFORWARD_VALUES = 3 * 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmLoad:
    """Wrench (6,) [N, N m] of the arm on the hull, at the hull's origin in hull axes."""

    contact_B: Array  # wrench of the contact; zero while free of contact
    wrench_B: Array  # total wrench


class Feedforward(Protocol):
    """Choice of the part of the arm's wrench that is fed forward."""

    def left_out(
        self, load: ArmLoad, contact: ContactState, estimate: StateEstimate
    ) -> Array | None:
        """Part (6,) [N, N m] of the arm's wrench that is not fed forward, hull axes; None: nothing.

        Args:
            load: the arm's wrench on the hull.
            contact: motion of arm and hull.
            estimate: present estimate of the vehicle.
        """
        ...


class ArmWrench:
    """Feed the whole wrench of the arm forward."""

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> None:
        """Nothing is left out."""

    def slot(self, state: None) -> Slot:
        """The feedforward is contained in the tick."""
        return empty_slot(state, FEEDFORWARD_VALUES)


class WithoutCompensation:
    """Feed only the weight of the arm in its home posture forward, regardless of its motion."""

    def __init__(self, arm: ArmDynamics, q_home: Array) -> None:
        self._home_wrench = arm.wrench_at_rest(np.array(q_home))

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> Array:
        """The whole wrench except that in the home posture."""
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
    """Feed the arm's wrench forward without some of the wrench's terms."""

    def __init__(
        self, arm: ArmDynamics, terms: Set[Term], *, acceleration_filter: float, period: float
    ) -> None:
        """Choose the terms.

        Args:
            arm: modelled dynamics of the arm.
            terms: terms to leave out.
            acceleration_filter: [s] filter of the joint acceleration in the contact estimator.
            period: [s] of the estimator's steps.
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
        qdd = (qd - sensed.qd_slow) / self._lag  # the estimator has advanced qd_slow by one period
        if "hydrodynamic" in self._without:
            left_out += self._terms.hydrodynamic(sensed.hull, q, qd, qdd)
        if "dynamic" in self._without:
            left_out += self._terms.dynamic(sensed.hull, q, qd, qdd)

        return left_out
