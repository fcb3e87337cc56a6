"""Recording of a run through some states, a second in each."""

from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from uuv import models
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.loop.recording import STATES, Event, Recording, Series

DT = 0.002  # [s] between samples


def recording(
    states: list[WorkState],
    set_force: Any = 60.0,
    true: Any = 60.0,
    note: str = "",
    abort: AbortCode | None = None,
    **more: Any,
) -> Recording:
    """A run through `states`, a second in each; `more` are other series (N, k), or other values of
    these.
    """
    ticks = round(1.0 / DT)
    time = np.array(np.arange(len(states) * ticks) * DT, dtype=np.float64)
    columns = {
        "state": np.repeat([STATES.index(state) for state in states], ticks).astype(float),
        "set_force": np.broadcast_to(set_force, time.shape),
        "contact_normal": np.broadcast_to(true, time.shape),
        "contact_most": np.broadcast_to(true, time.shape),
        **more,
    }
    return Recording(
        timestep=DT,
        duration=len(time) * DT,
        vehicle=vehicle(),
        series=MappingProxyType(
            {
                name: Series(
                    time=time, value=np.array(v).reshape(len(time), -1), unit="", labels=()
                )
                for name, v in columns.items()
            }
        ),
        events=tuple(
            Event(time=float(i), state=state, note=note, abort=abort)
            for i, state in enumerate(states)
        ),
        targets=(),
        clouds=MappingProxyType({}),
    )


@cache
def vehicle() -> Vehicle:
    return Vehicle.of(models.load("uuv_puma").compile())
