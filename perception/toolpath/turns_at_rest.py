"""Corners in which a tool that is not round stops and turns, as parts of its path."""

from dataclasses import replace

import numpy as np

from uuv.models.objects.axis_steps import Steps, rotated
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import readonly

_LENGTH = 0.02  # [m] by which s of a path grows in a turn of 1 rad, as if the tool moved
_EACH = 0.05  # [rad] between two samples of a turn


def turning_at_rest(path: ToolPath) -> ToolPath:
    """`path` with an additional part for each step of its x axis, in which the tool stays in place
    and turns.
    """
    steps = Steps.of(path.z, path.x)
    if not len(steps.after):
        return path

    # Rows of the longer path: a sample, and the samples of the turn after it
    count = np.ones(len(path.s), dtype=np.int64)
    count[steps.after] += np.ceil(np.abs(steps.angle) / _EACH).astype(np.int64)
    row = np.repeat(np.arange(len(path.s)), count)
    turned = np.zeros(len(row))
    for last, angle, first in zip(
        steps.after, steps.angle, np.cumsum(count)[steps.after] - count[steps.after], strict=True
    ):
        turned[first : first + count[last]] = np.linspace(0.0, angle, count[last])

    s = path.s[row]
    z = path.z[row]
    x = path.x[row]
    longer = np.diff(turned, prepend=0.0)

    # the first point of each row is the path's own
    longer[np.concatenate([[True], np.diff(row) > 0])] = 0.0

    return replace(
        path,
        s=readonly(s + _LENGTH * np.cumsum(np.abs(longer))),
        p=readonly(path.p[row]),
        z=readonly(z),
        x=readonly(rotated(z, x, turned)),
        on_scan=path.on_scan[row],
        fits=None if path.fits is None else path.fits[row],
    )
