"""Figures of a report on work in the seabed: vehicle over the ground, forces, depth, tip."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from uuv.sim.evaluation.seabed_metrics import IN_THE_SOIL, TrueGround, tip_depth
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.palette import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION, WIDTH
from uuv.sim.interfaces.spatial import Array, pose, rotation_from_quat_wxyz, transform_points
from uuv.sim.loop.recording import Recording

_THIN = 5  # one of so many steps is drawn
_BESIDE = 0.1  # [m] distance from the section plane within which points of the scan are drawn


def seabed_figures(recording: Recording, truth: TrueGround) -> Iterator[tuple[str, str, Figure]]:
    """Draw the figures; those of the soil only if the tool entered it.

    Args:
        recording: The run.
        truth: True ground and commanded work.

    Yields:
        Title, caption and figure.
    """
    caption = (
        "Section along the hull's heading, as it is at work, else at the end: the true ground, "
        f"the scan within {_BESIDE:g} m of the section, the identified targets, hull and arm."
    )
    yield "Vehicle at its height", caption, _section(recording, truth)

    rows = np.flatnonzero(recording.within(*IN_THE_SOIL))[::_THIN]
    if len(rows):
        yield (
            "In the soil",
            "True and estimated force along the tool, true depth of its tip, height of the hull.",
            _soil(recording, truth, rows),
        )

    if recording.within(WorkState.WORK).any() and truth.push is None:
        yield (
            "Along the profile",
            "The tip, the commanded path and the true ground, in side view.",
            _profile(recording, truth),
        )


def _section(recording: Recording, truth: TrueGround) -> Figure:
    work = np.flatnonzero(recording.within(WorkState.WORK))
    row = int(work[len(work) // 2]) if len(work) else len(recording["p_WB"].time) - 1
    R_WB = rotation_from_quat_wxyz(recording["quat_WB_wxyz"].value[row])
    p_WB = recording["p_WB"].value[row]
    heading = R_WB[:2, 0] / np.linalg.norm(R_WB[:2, 0])

    def seen(points: Array) -> Array:
        """Coordinates (N, 2) [m] along the heading from the hull, up from the terrain's middle."""
        return np.column_stack(
            [(points[:, :2] - p_WB[:2]) @ heading, points[:, 2] - truth.ground.center_W[2]]
        )

    figure = Figure(figsize=(WIDTH, 4.5), layout="constrained")
    axes = figure.subplots()

    # True ground under the tip.
    tip = recording["p_pad"].value[row]
    beside = np.array([-heading[1], heading[0]])
    off = float((tip[:2] - p_WB[:2]) @ beside)
    along = np.linspace(-1.6, 1.8, 400)
    xy = p_WB[:2] + along[:, None] * heading + off * beside
    axes.plot(
        along,
        truth.ground.height(xy) - truth.ground.center_W[2],
        color=INK,
        linewidth=1.2,
        label="true ground",
    )

    # Scan near the section.
    scan = recording.clouds.get("scan", np.zeros((0, 3)))
    near = np.abs((scan[:, :2] - p_WB[:2]) @ beside - off) < _BESIDE
    scan = seen(scan[near])
    within = (scan[:, 0] > along[0]) & (scan[:, 0] < along[-1])
    axes.plot(*scan[within].T, ".", color=FAINT, markersize=2, label="scan")

    # Hull, arm and targets.
    (x0, _, z0), (x1, _, z1) = truth.hull_box
    corners = np.array([[x0, 0, z0], [x1, 0, z0], [x1, 0, z1], [x0, 0, z1], [x0, 0, z0]])
    axes.plot(
        *seen(transform_points(pose(R_WB, p_WB), corners)).T,
        color=ORANGE,
        linewidth=1.5,
        label="hull",
    )

    if "body_pose" in recording:
        poses = recording["body_pose"]
        body_poses = poses.value[
            np.searchsorted(poses.time, recording["p_WB"].time[row]) - 1
        ].reshape(-1, 7)
        links = [i for i, name in enumerate(poses.labels) if name.startswith(("arm_base", "link"))]
        axes.plot(
            *seen(np.vstack([body_poses[links, :3], tip])).T,
            "o-",
            color=BLUE,
            markersize=3,
            label="arm",
        )

    targets = recording.clouds.get("targets")
    if targets is not None:
        axes.plot(*seen(targets).T, "^", color=VERMILION, label="targets")

    axes.set_aspect("equal")
    axes.set_xlabel("along the heading [m]")
    axes.set_ylabel("height [m]")
    axes.legend(frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _soil(recording: Recording, truth: TrueGround, rows: np.ndarray) -> Figure:
    time = recording["p_pad"].time[rows]
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    force, depth, hull = figure.subplots(3, 1, sharex=True)

    force.plot(
        time, recording["felt_normal"].scalar[rows], color=ORANGE, linewidth=0.8, label="felt"
    )
    force.plot(
        time, recording["contact_normal"].scalar[rows], color=BLUE, linewidth=0.8, label="true"
    )
    if truth.push is not None:
        force.axhline(truth.push, color=FAINT, linewidth=0.8, linestyle="--")
    force.set_ylabel("push [N]")
    force.legend(frameon=False, fontsize=9, ncols=2)

    depth.plot(time, 1e3 * tip_depth(recording, truth.ground)[rows], color=BLUE, linewidth=1.0)
    depth.invert_yaxis()
    depth.set_ylabel("depth [mm]")

    p_WB = recording["p_WB"].value[rows]
    for axis, color, label in ((2, VERMILION, "up"), (0, BLUE, "x"), (1, GREEN, "y")):
        hull.plot(
            time, 1e3 * (p_WB[:, axis] - p_WB[0, axis]), color=color, linewidth=0.8, label=label
        )
    hull.set_ylabel("hull [mm]")
    hull.set_xlabel("time [s]")
    hull.legend(frameon=False, fontsize=9, ncols=3)

    # Changes of state.
    for event in recording.events:
        if time[0] - 1e-9 <= event.time <= time[-1]:
            for axes in (force, depth, hull):
                axes.axvline(event.time, color=FAINT, linewidth=0.6)
            label = f" {event.state.value}"
            force.text(
                event.time,
                1.01,
                label,
                transform=force.get_xaxis_transform(),
                fontsize=8,
                rotation=30,
            )

    return figure


def _profile(recording: Recording, truth: TrueGround) -> Figure:
    rows = np.flatnonzero(recording.within(WorkState.WORK))[::_THIN]
    tip = recording["p_pad"].value[rows]
    command = recording["p_command"].value[rows]
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(command[:, :2], axis=0), axis=1))])

    figure = Figure(figsize=(WIDTH, 3.5), layout="constrained")
    axes = figure.subplots()
    level = truth.ground.center_W[2]

    axes.plot(
        s,
        1e3 * (truth.ground.height(command) - level),
        color=INK,
        linewidth=1.2,
        label="true ground",
    )
    axes.plot(
        s,
        1e3 * (command[:, 2] - level),
        color=ORANGE,
        linewidth=1.0,
        linestyle="--",
        label="reference",
    )
    axes.plot(s, 1e3 * (tip[:, 2] - level), color=BLUE, linewidth=1.0, label="tip")

    axes.set_xlabel("along the path [m]")
    axes.set_ylabel("height [mm]")
    axes.legend(frameon=False, fontsize=9, ncols=3)
    return figure
