"""A driven vehicle under scripted inputs: a hull that is where it should be, and a floor."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from driving_rows import Steps, rows_of
from scripted_world import UNTOUCHED, ScriptedWorld
from uuv import models
from uuv.controllers.driving.drive_phase import OUT_OF_REACH
from uuv.controllers.driving.driven_task import driven_task
from uuv.controllers.driving.operator_inputs import OperatorInputs
from uuv.controllers.mkps import Chain
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import (
    AbortCode,
    ContactEstimate,
    Reference,
    StateEstimate,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

PERIOD, STIFFNESS = 0.02, 3e4  # [s], [N/m]
START = pose(exp_so3([0.0, 0.0, 0.4]), [-1.0, 0.2, 0.5])
DOWN = 0.06  # [m] from the tool at the begin of the inputs to the floor
FREE, GUARDED, CONTACT = WorkState.CLOSE_IN, WorkState.APPROACH, WorkState.WORK
TO_FLOOR = (30.0, {"tool_z": 0.02, "set_force": 60.0})


def tip(reference: Reference) -> Array:
    assert reference.X_WG is not None
    return reference.X_WG[:3, 3]


@dataclass
class Ride(ScriptedWorld):
    """Drives a planner by inputs; every reference that it gives is kept."""

    steps: Steps = ()
    delay: float = 0.0
    felt: Callable[[Reference, float], float] | None = None  # [N] by reference and height of floor
    ready: float = field(default=np.inf, init=False)  # [s] when the inputs began
    floor: float = field(default=-np.inf, init=False)  # [m] its height

    def run(self) -> "Ride":
        model = models.load("uuv_puma").compile()
        vehicle = Vehicle.of(model)
        chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=["pad"])
        own = WorkVehicle(vehicle=vehicle, chain=chain, hull_box=np.zeros((2, 3)))
        inputs = OperatorInputs(rows_of(self.steps))
        planner = driven_task(own, inputs, self.delay, X_WB=START)
        planner.period = PERIOD
        return self.drive(planner, START, 12_000 * PERIOD)

    def estimated(self, estimate: StateEstimate, reference: Reference | None) -> StateEstimate:
        return estimate if reference is None else replace(estimate, q=reference.q)

    def feel(self, reference: Reference, time: float) -> ContactEstimate:
        if self.state.row == "free" and not np.isfinite(self.ready):
            self.ready = time
            self.floor = float(tip(reference)[2]) - DOWN
        if reference.X_WG is None:
            return UNTOUCHED
        return ContactEstimate(normal=(self.felt or _floor)(reference, self.floor))

    def at(self, time: float) -> Reference:
        """Reference at a time [s] of the inputs."""
        return min(self.references, key=lambda r: abs(r.time - self.ready - time))


def _floor(reference: Reference, floor: float) -> float:
    """Under force control the set force, as long as the tool is down there; else a spring."""
    deep = max(0.0, floor - float(tip(reference)[2]))
    return reference.set_force if reference.force_control and deep else STIFFNESS * deep


def test_hull_and_tool_follow_with_the_delay_and_within_their_accelerations(within):
    ahead = {"surge": 0.1, "yaw_rate": 0.05, "tool_y": 0.02}
    steps = ((4.0, ahead), (6.0, {}))
    rides = [Ride(steps, delay=delay).run() for delay in (0.0, 0.8)]
    plain, late = rides
    for time in (0.4, 2.0, 6.0):
        one, other = plain.at(time), late.at(time + 0.8)
        within("hull, later", one.X_WB - other.X_WB, 1e-9)
        within("tool, later", tip(one) - tip(other), 1e-9)

    # At rest until the first row; then as fast as asked for, along the hull's own axis
    within("before", plain.at(0.4).X_WB - START, 1e-12)
    driven = plain.at(4.0)
    speed = driven.X_WB[:3, :3].T @ driven.v_WB_W
    within("hull's speed [m/s]", speed - [0.1, 0.0, 0.0], 2e-3)
    speeds = np.array([r.v_WB_W for r in plain.references])
    within("hull's acceleration [m/s2]", np.diff(speeds, axis=0) / PERIOD, 0.09)

    # The tool's velocity is that of its pose
    before, after = plain.at(3.0), plain.at(3.0 + PERIOD)
    rate = (tip(after) - tip(before)) / PERIOD
    within("tool's speed [m/s]", rate - after.v_WG_W, 1e-9)
    assert plain.end.state is WorkState.DONE


def test_with_a_set_force_the_tool_comes_slowly_and_the_force_loop_takes_over(within):
    wipe = {"tool_x": 0.02, "tool_z": 0.05, "heave": -0.02, "set_force": 60.0}
    ride = Ride((TO_FLOOR, (4.0, wipe), (4.0, {}))).run()
    assert ride.states[3:] == [FREE, GUARDED, CONTACT, WorkState.RETREAT, FREE, WorkState.DONE]

    slow = np.diff([tip(r) for r in ride.of(GUARDED)], axis=0) / PERIOD
    within("approach [m/s]", slow, 4e-3 + 1e-9)
    pressed = ride.of(CONTACT)
    assert all(r.force_control for r in pressed)
    assert max(r.set_force for r in pressed) == 60.0
    assert np.abs(np.diff([r.set_force for r in pressed])).max() <= 60.0 * PERIOD + 1e-9

    # Across the tool's axis alone, though hull and operator push along it
    X_WG = pressed[-1].X_WG
    assert X_WG is not None
    axis = X_WG[:3, 2]
    way = tip(pressed[-1]) - tip(pressed[0])
    within("along the axis [m]", way @ axis, 1e-4)
    assert np.linalg.norm(way) > 0.05

    # Without a set force the tool leaves, and can be driven on
    off = tip(ride.end) - tip(pressed[-1])
    assert off @ axis == pytest.approx(-0.05, abs=1e-3)


def test_an_open_clutch_holds_what_there_is(within):
    opened = {"clutch": 0.0, "tool_x": 0.05, "surge": 0.2}
    ride = Ride((TO_FLOOR, (4.0, opened))).run()
    held = [r for r in ride.of(CONTACT) if r.time - ride.ready > 32.0]
    assert {r.set_force for r in held} == {60.0}
    within("tool [m]", tip(held[-1]) - tip(held[0]), 1e-9)
    within("hull [m]", held[-1].X_WB - held[0].X_WB, 1e-9)


def test_inputs_that_end_in_contact_hold_release_and_retreat():
    ride = Ride((TO_FLOOR,)).run()
    assert ride.states[-3:] == [CONTACT, WorkState.RETREAT, WorkState.DONE]
    end = ride.of(CONTACT)[-1]
    assert end.time - ride.ready - 30.5 == pytest.approx(2.0, abs=0.1)
    assert end.note == "the inputs ended"
    assert ride.end.abort is None
    off = tip(ride.of(WorkState.RETREAT)[-1]) - tip(end)
    assert np.linalg.norm(off) == pytest.approx(0.1, abs=2e-3)


def test_contact_without_a_set_force_stops_the_tool():
    ride = Ride(((10.0, {"tool_z": 0.01}),)).run()
    assert ride.end.state is WorkState.DONE
    assert CONTACT not in ride.states
    deepest = min(float(tip(r)[2]) for r in ride.references if r.X_WG is not None)
    end = float(tip(ride.end)[2])
    assert end - deepest < 1e-9  # stopped where 6 N are felt
    assert float(tip(ride.at(0.0))[2]) - deepest == pytest.approx(DOWN, abs=1e-3)


def test_too_much_force_ends_the_drive_off_the_surface():
    def hard(reference: Reference, floor: float) -> float:
        low = float(tip(reference)[2]) < floor
        return 150.0 if low and reference.set_force > 30.0 else _floor(reference, floor)

    ride = Ride((TO_FLOOR, (5.0, {"set_force": 60.0})), felt=hard).run()
    assert ride.end.abort is AbortCode.FORCE_LIMIT
    assert WorkState.RETREAT in ride.states


def test_the_tool_stops_at_the_end_of_the_arms_reach(within):
    ride = Ride(
        ((20.0, {"tool_z": 0.1}), (3.0, {"surge": 0.1}), (4.0, {})), felt=lambda *_: 0.0
    ).run()
    notes = {r.note for r in ride.references}
    assert "the tool is at the end of the arm's reach" in notes
    assert ride.end.state is WorkState.DONE
    stopped, carried = ride.at(20.0), ride.at(26.0)
    moved = tip(carried) - tip(stopped) - (carried.X_WB - stopped.X_WB)[:3, 3]
    within("tool against the hull [m]", moved, 1e-9)
    assert np.linalg.norm((carried.X_WB - stopped.X_WB)[:3, 3]) > 0.2


def test_a_hull_does_not_carry_a_tool_at_the_end_of_its_reach_into_an_object(within):
    stop = -np.inf  # [m] height of the drawn-in tool, 3 cm over a floor

    def below(reference: Reference, floor: float) -> float:
        del floor
        nonlocal stop
        low = float(tip(reference)[2])
        if reference.X_WB[2, 3] == START[2, 3]:
            stop = max(stop, low)
        return STIFFNESS * max(0.0, stop - 0.03 - low)

    steps = ((20.0, {"tool_z": -0.1}), (5.0, {"heave": -0.05}), (3.0, {"heave": 0.05}))
    ride = Ride(steps, felt=below).run()
    assert ride.end.state is WorkState.DONE, ride.end.note
    lowest = min(float(tip(r)[2]) for r in ride.references if r.time > ride.ready + 20.0)
    within("into the floor [m]", lowest - (stop - 0.03), 1e-3)  # 6 N are felt after 0.2 mm

    # Off it again, with the hull
    assert float(tip(ride.end)[2]) - lowest > 0.1


def test_a_tool_that_cannot_be_lifted_as_far_as_it_should_can_be_driven_on(within):
    under: list[float] = []  # [m] height of a floor 2 cm under the drawn-in tool

    def near(reference: Reference, floor: float) -> float:
        del floor
        if reference.state is GUARDED and not under:
            under.append(float(tip(reference)[2]) - 0.02)
        return _floor(reference, under[0]) if under else 0.0

    steps = (
        (8.0, {"tool_z": -0.1}),
        (12.0, {"tool_z": 0.02, "set_force": 60.0}),
        (10.0, {}),
        (4.0, {"tool_x": 0.02}),
    )
    ride = Ride(steps, felt=near).run()
    assert CONTACT in ride.states
    assert ride.end.state is WorkState.DONE
    assert OUT_OF_REACH in {r.note for r in ride.of(FREE) if r.time - ride.ready > 20.0}

    # From where the arm stands
    before, after = ride.at(30.0), ride.at(36.0)
    within("in the surface [m]", under[0] - tip(before)[2], 1e-2)
    assert np.linalg.norm(tip(after) - tip(before)) > 0.05
