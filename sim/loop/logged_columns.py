"""Columns of the logged series: names, components and units."""

from collections.abc import Mapping

from uuv.models.vehicle import Vehicle

_XYZ = ("x", "y", "z")

# Columns of the blocks: series name -> (labels, unit), in the order of the columns in a row.
Columns = Mapping[str, tuple[tuple[str, ...], str]]
SCALARS: Columns = {
    # true force of the tool on the object: mean over the plant's substeps
    "contact_normal": ((), "N"),
    "contact_least": ((), "N"),  # smallest value of a substep
    "contact_most": ((), "N"),  # largest value of a substep
    "saturated": ((), ""),
    "collision": ((), ""),
    "felt_normal": ((), "N"),  # force estimated from joint torques
}
VECTORS: Columns = {
    "p_pad": (_XYZ, "m"),  # true position of the tip
    "tool_axis": (_XYZ, ""),
    "p_WB": (_XYZ, "m"),
    "quat_WB_wxyz": (("w", "x", "y", "z"), ""),
    "contact_force": (_XYZ, "N"),  # true force of the world on the pad
    "felt_force": (_XYZ, "N"),
    "tool_x": (_XYZ, ""),
}
REFERENCE: Columns = {
    "state": ((), ""),
    "set_force": ((), "N"),
    "path_s": ((), "m"),
    # commanded tip, extrapolated by its velocity; NaN while the arm holds joint angles
    "p_command": (_XYZ, "m"),
    "v_command": (_XYZ, "m/s"),
    "p_WB_reference": (_XYZ, "m"),
}
# true pose of the object, if it can move
OBJECT: Columns = {"p_WT": (_XYZ, "m"), "quat_WT_wxyz": (("w", "x", "y", "z"), "")}
EVERY_STEP = (*SCALARS, *VECTORS, *REFERENCE)  # series of every recording, full or not
WIDTHS = {  # [columns] width of each of these series
    name: max(1, len(labels)) for name, (labels, _) in {**SCALARS, **VECTORS, **REFERENCE}.items()
}


JAWS: Columns = {
    "jaw_opening": ((), "m"),  # true, between the pads
    "jaw_force": ((), "N"),  # of the motor on each finger, positive: it closes
}
HANDLE: Columns = {
    "handle_angle": ((), "rad"),  # true, from its angle at the start
    "handle_moment": ((), "N m"),  # true, of the tool about the valve's axis
}


def slow_columns(vehicle: Vehicle, *, jaws: bool = False, handle: bool = False) -> Columns:
    """Columns of the series that are logged at a lower rate, with `jaws` also of a gripper, with
    `handle` of a valve.
    """
    columns: Columns = {
        "q": (vehicle.joint_names, "rad"),
        "qd": (vehicle.joint_names, "rad/s"),
        "tau_drive": (vehicle.joint_names, "N m"),
        "thrust": (vehicle.thruster_names, "N"),
        "current": (_XYZ, "m/s"),
        # true wrench of the arm on the hull, hull axes
        "arm_wrench": (("fx", "fy", "fz", "mx", "my", "mz"), "N, N m"),
        "p_WB_estimate": (_XYZ, "m"),
        "quat_WB_estimate_wxyz": (("w", "x", "y", "z"), ""),
        # standard deviation of the estimated hull position, as the estimator states it
        "position_sigma": (_XYZ, "m"),
    }
    return {**columns, **(JAWS if jaws else {}), **(HANDLE if handle else {})}
