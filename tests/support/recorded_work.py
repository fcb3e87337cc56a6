"""A recording made by hand: a tool on a perfect path along a barrel that lies askew."""

from types import MappingProxyType

import numpy as np

from uuv import models
from uuv.models.objects.targets import barrel
from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.surface.tool_errors import TrueObject
from uuv.sim.interfaces.messages import Target, WorkState
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points
from uuv.sim.loop.recording import STATES, Event, Recording, Series

DT = 0.002  # [s]
SPEED = 0.05  # [m/s]
STEPS = 5000
TIME = DT * np.arange(STEPS, dtype=np.float64)
TRUTH = TrueObject(
    model=barrel(), path="longitudinal", X_WT=pose(exp_so3([0.1, -0.2, 0.3]), [1.0, 0.1, -1.5])
)
VEHICLE = Vehicle.of(models.load("uuv_puma").compile())
# series that there may be
_ALSO = {"contact_least", "contact_most", "p_WB_reference", "p_WT", "quat_WT_wxyz"}


def recorded(
    during: WorkState = WorkState.WORK, final: WorkState = WorkState.DONE, **changed: np.ndarray
) -> Recording:
    """10 s in one state at 60 N on a perfect path along the barrel, but for what is `changed`."""
    start_T = TRUTH.model.path("longitudinal").p[0]
    p_T = start_T + SPEED * TIME[:, None] * [1.0, 0.0, 0.0]
    tip = transform_points(TRUTH.X_WT, p_T)
    R_WT = TRUTH.X_WT[:3, :3]
    ones = np.ones((STEPS, 1))
    columns = {
        "state": STATES.index(during) * ones,
        "contact_normal": 60.0 * ones,
        "set_force": 60.0 * ones,
        "felt_normal": 60.0 * ones,
        "felt_force": ones * [0.0, 0.0, 60.0],
        "contact_force": ones * [0.0, 0.0, 60.0],
        "saturated": 0.0 * ones,
        "collision": 0.0 * ones,
        "path_s": SPEED * TIME[:, None],
        "p_command": tip,
        "v_command": ones * (SPEED * R_WT[:, 0]),
        "p_pad": tip,
        "tool_axis": ones * -R_WT[:, 2],
        "tool_x": ones * R_WT[:, 0],
        "p_WB": ones * [0.0, 0.0, 0.0],
        "quat_WB_wxyz": ones * [1.0, 0.0, 0.0, 0.0],
    }
    assert not changed.keys() - columns.keys() - _ALSO
    columns |= changed
    for name in ("contact_least", "contact_most"):  # as where the plant has no substeps
        columns.setdefault(name, columns["contact_normal"])
    series = {
        name: Series(
            time=TIME,
            value=np.asarray(numbers, dtype=np.float64).reshape(STEPS, -1),
            unit="",
            labels=(),
        )
        for name, numbers in columns.items()
    }
    target = Target(
        time=0.0, X_WT=TRUTH.X_WT, accepted=True, check_m=0.001, range_m=1.2, reason="", path=None
    )
    note = "felt force 170 N" if final is WorkState.ABORT else ""
    return Recording(
        timestep=DT,
        duration=STEPS * DT,
        vehicle=VEHICLE,
        series=MappingProxyType(series),
        events=(Event(time=0.0, state=during, note=""), Event(time=10.0, state=final, note=note)),
        targets=(target,),
        clouds=MappingProxyType({}),
    )
