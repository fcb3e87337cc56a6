"""Rows of foreseen set points: taken as they are, and left where a bound is passed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from uuv.sim.interfaces.kernels.control import Commanded, commanded
from uuv.sim.interfaces.kernels.foresight import EstimateBounds, Foresight, ReferenceTable, take_row
from uuv.sim.interfaces.messages import Reference, WorkState
from uuv.sim.interfaces.records import (
    EstimateRecord,
    estimate_record,
    reference_record,
    take_reference,
)
from uuv.sim.interfaces.spatial import exp_so3, pose

N, M = 6, 8
TIMES = (2.01, 2.02, 2.03)  # [s]
LIMITS = EstimateBounds(0.2, 0.3, 0.4, 50.0, -10.0, 90.0, 5.0, 0.01)


def references() -> list[Reference]:
    """Set points whose numbers all differ; the last follows no tool pose."""
    rng = np.random.default_rng(3)
    made = []
    for time in TIMES:
        X_WB = pose(exp_so3(rng.normal(size=3)), rng.normal(size=3))
        X_WG = pose(exp_so3(rng.normal(size=3)), rng.normal(size=3))
        v, w, v_G, w_G = rng.normal(size=(4, 3))
        made.append(
            Reference(
                time=time,
                state=WorkState.WORK,
                X_WB=X_WB,
                v_WB_W=v,
                w_WB_W=w,
                X_WG=X_WG,
                v_WG_W=v_G,
                w_WG_W=w_G,
                q=rng.normal(size=N),
                qd=rng.normal(size=N),
                set_force=float(rng.uniform(1.0, 90.0)),
                force_control=True,
                tare=False,
                scan=False,
                path_s=0.0,
                compliant=True,
            )
        )
    return [*made[:2], replace(made[2], X_WG=None, set_force=0.0, force_control=False)]


def table(within: EstimateBounds) -> ReferenceTable:
    """Three rows under the same bounds."""
    filled = ReferenceTable(N)
    seen: Any = (None, None)
    filled.fill(Foresight(references(), TIMES, [within] * 3, seen))
    return filled


def within_limits() -> tuple[EstimateRecord, Commanded]:
    """Estimate and command inside LIMITS, at the reference of `reference_record`."""
    estimate, command = estimate_record(N), commanded(N, M)
    command.f_W[:], command.felt[0], command.sigma_G[:] = [1.0, 2.0, 20.0], 20.0, 2.0
    return estimate, command


def flat(record: Any) -> np.ndarray:
    """All numbers of a record."""
    return np.concatenate([np.ravel(array).astype(float) for array in record])


def test_rows_are_taken_in_turn_at_their_times_as_a_message_is():
    rows, record, expected = table(EstimateBounds()), reference_record(N), reference_record(N)
    estimate, command = within_limits()
    for k, (time, reference) in enumerate(zip(TIMES, references(), strict=True)):
        assert rows.taken == k
        estimate.time[0] = time
        assert take_row(rows.record, estimate, command, record)
        take_reference(expected, reference)
        assert np.array_equal(flat(record), flat(expected))
        present = rows.present()
        assert present is not None
        assert present.time == time
    rows.clear()
    assert rows.present() is None


def test_a_row_is_left_at_any_other_time():
    rows, record = table(EstimateBounds()), reference_record(N)
    estimate, command = within_limits()
    for time in (2.0, np.nextafter(2.01, 3.0), 2.02, np.nan):
        estimate.time[0] = time
        assert not take_row(rows.record, estimate, command, record)
    assert rows.taken == 0


@pytest.mark.parametrize("name", EstimateBounds._fields)
def test_each_bound_alone_leaves_the_row(name: str):
    """On the bound to a rounding, and beyond."""
    limit = getattr(LIMITS, name)

    def taken(value: float, bounds: EstimateBounds) -> bool:
        estimate, command = within_limits()
        estimate.time[0] = TIMES[0]
        along = np.array([2.0, -1.0, 2.0]) / 3.0
        reference = reference_record(N)
        estimate.X_WB[:3, 3] = reference.X_WB[:3, 3] = [1.0, 2.0, -3.0]
        estimate.X_WB[:3, 3] += value * along if name == "off" else 0.0
        estimate.v_WB_B[:] = value * along if name == "speed" else 0.0
        estimate.w_WB_B[:] = value * along if name == "turn" else 0.0
        estimate.object_moved_W[1] = -value if name == "moved" else 0.0
        if name in ("normal", "slack"):
            command.felt[0] = value if name == "normal" else -value
        if name == "force":
            command.f_W[:] = np.sqrt(value**2 - command.felt[0] ** 2) * along
        if name == "sigma":
            command.sigma_G[2] = value
        return bool(take_row(table(bounds).record, estimate, command, reference))

    alone = EstimateBounds(**{name: limit})
    for bounds in (alone, LIMITS):
        assert taken(limit - 1e-6 * abs(limit), bounds)
        assert not taken(limit + 1e-6 * abs(limit), bounds)
    assert not taken(np.nan, alone)
    assert taken(limit + 1e3, EstimateBounds())
