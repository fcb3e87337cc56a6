"""The check of a vehicle: `check_vehicle("rov.xml")`."""

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from uuv.check import doubts
from uuv.check.checked_jobs import ARM_JOBS, HOVERING, JOBS, check_jobs, check_options
from uuv.check.conditions import Conditions
from uuv.check.findings import (
    JobVerdict,
    Level,
    VehicleCheck,
    VehicleFigure,
    VehicleFinding,
    VehiclePart,
)
from uuv.check.hover import rigid
from uuv.check.hovering import hover_verdict
from uuv.check.jobs import ArmJobs, Watch
from uuv.check.statics import (
    AXES,
    FASTEST,
    Trim,
    authority,
    full_draw,
    seen_workspace,
    strongest_current,
    tip_force,
    trim_of,
    weight_of,
)
from uuv.jobs import clean_barrel
from uuv.models import hydrodynamics as coefficients
from uuv.models.completing.mapping import BARE_ARM, MOUNT
from uuv.models.completing.postures import PostureSearch
from uuv.models.files.holding import loops
from uuv.models.files.notes import computed, entries_of
from uuv.models.naming import HOME_KEY, READY_KEY, parts
from uuv.models.tools.tools import TOOLS
from uuv.models.vehicle import Vehicle
from uuv.models.water import battery_feed
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError, PhysicsWarning, UuvError
from uuv.tasks.surface_work import SurfaceWorkTask

# codes of faults with which station keeping is still simulated
_OF_ARM = ("motor", "thruster-rank", "timestep")


def check_vehicle(
    vehicle: str | Path | mujoco.MjSpec,
    *,
    parts_file: str | Path | None = None,
    tool: str | None = None,
    jobs: Sequence[str] = JOBS,
    conditions: Conditions | None = None,
    watch: Watch | None = None,
) -> VehicleCheck:
    """Check a vehicle: parts, figures, findings, and which jobs are feasible.

    Args:
        vehicle: A name, a file (MJCF, URDF, xacro or SDF), MODULE:FUNCTION, or a spec, which is
            not changed.
        parts_file: Mapping of its names; None: NAME.parts.yaml in the folder of its file.
        tool: Tool of `uuv.models.tools.tools.TOOLS` on its tip; None: its own.
        jobs: Names of `uuv.check.checked_jobs.ALL_JOBS` for which a verdict is wanted.
        conditions: Poses of the object that are drawn for each job of the arm, and options of the
            jobs; None: 20 poses, and the jobs' own options. A job is promised if 95 % of the poses
            pass.
        watch: Called with the job, the poses that are done, and how many there are.

    Returns:
        The check. A spec that cannot be compiled has one finding of level "fault".

    Raises:
        ConfigurationError: There is no such vehicle, tool or job, no job takes an option of the
            conditions, or a file cannot be read or compiled.
    """
    check_jobs(jobs)
    under = Conditions() if conditions is None else conditions
    check_options(jobs, under)
    file = None if parts_file is None else str(parts_file)
    if isinstance(vehicle, str | Path):
        name = str(vehicle)
        spec = _with_battery(vehicle_spec(name, tool, file), under)
        arm_jobs = ArmJobs(name, tool=tool, parts=file, conditions=under, watch=watch)
        return _Check(name, spec, arm_jobs).run(jobs)
    if tool is not None:
        TOOLS.load(tool)  # an unknown tool is an error of the caller, not a finding on the spec
    name = vehicle.modelname or "vehicle"

    try:
        spec = _with_battery(vehicle_spec(vehicle, tool, file), under)
    except UuvError as error:
        message = " ".join(str(error).split())
        code = "inertia" if "inertia" in message else "contract"
        return VehicleCheck(
            vehicle=name, findings=(VehicleFinding(code=code, level="fault", said=message),)
        )

    arm_jobs = ArmJobs(name, conditions=under, override=spec, watch=watch)
    return _Check(name, spec, arm_jobs).run(jobs)


def _with_battery(spec: mujoco.MjSpec, conditions: Conditions) -> mujoco.MjSpec:
    """The spec itself, with the battery of the conditions."""
    if conditions.battery is not None:
        battery_feed.attach(spec, conditions.battery)
    return spec


class _Check:
    """A check in progress, with the findings and figures so far."""

    def __init__(self, name: str, spec: mujoco.MjSpec, arm_jobs: ArmJobs) -> None:
        self._name, self._spec, self._jobs = name, spec, arm_jobs
        self._findings: list[VehicleFinding] = []
        self._figures: list[VehicleFigure] = []

    def run(self, jobs: Sequence[str]) -> VehicleCheck:
        """Carry out the check."""
        rows = self._parts()
        wet = self._compiled()
        model = wet if wet is not None else self._spec.compile()
        vehicle = self._vehicle(model)

        blocked = 0.0
        if vehicle is not None:
            self._described(model, vehicle, wet is not None)
            if vehicle.tip >= 0:
                blocked = self._arm(model, vehicle, wet is not None)
        if closed := loops(self._spec):
            line = f"closed loop: {', '.join(closed)}; hovering is judged with the arm held"
            self._note("closed-loop", "doubt", line)
        usable = vehicle if wet is not None else None

        verdicts = tuple(self._verdict(job, model, usable, blocked) for job in jobs)
        return VehicleCheck(
            vehicle=self._name,
            parts=tuple(rows),
            file=entries_of(self._spec),
            figures=tuple(self._figures),
            findings=tuple(self._findings),
            jobs=verdicts,
        )

    def _parts(self) -> list[VehiclePart]:
        added = computed(self._spec)
        rows = []

        for word, name, use, present in parts(self._spec.compile()):
            state = "computed" if name in added else "there" if present else "missing"
            rows.append(
                VehiclePart(name=f"{word} {name}", use=use, state=state, said=added.get(name, ""))
            )
            if not present:
                self._note(
                    "missing",
                    "doubt",
                    f"{word} {name} ({use})"
                    if name != "thrusters"
                    else "thrusters (hold the hull)",
                )

        if any(part.state == "missing" for part in rows):
            hint = (
                "map the names of the missing parts in NAME.parts.yaml in the folder of its file, "
                "see docs/own_vehicle.md"
            )
            self._note("mapping", "note", hint)

        for name, line in added.items():
            self._note(f"computed-{name}" if not name.startswith("note") else "file", "note", line)
        return rows

    def _note(self, code: str, level: Level, message: str) -> None:
        self._findings.append(VehicleFinding(code=code, level=level, said=message))

    def _compiled(self) -> mujoco.MjModel | None:
        """The model compiled with water; None, and a fault, if that is not possible."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PhysicsWarning)  # its doubts are findings here
                return hydrodynamics.compile(self._spec.copy())
        except HydrodynamicsError as error:
            message = str(error)
            code = (
                "timestep"
                if message.startswith("timestep")
                else "density"
                if "volume" in message
                else "water"
            )

            self._note(code, "fault", message)
            if code == "density":
                self._densities()
        except UuvError as error:
            self._note("water", "fault", str(error))
        return None

    def _densities(self) -> None:
        for doubt in hydrodynamics.doubts(self._spec.compile()):
            self._note("density", "doubt", doubt)

    def _vehicle(self, model: mujoco.MjModel) -> Vehicle | None:
        try:
            return Vehicle.of(model)
        except UuvError as error:
            self._note("contract", "fault", str(error))
            return None

    def _figure(self, name: str, text: str) -> None:
        self._figures.append(VehicleFigure(name=name, said=text))

    def _described(self, model: mujoco.MjModel, vehicle: Vehicle, wet: bool) -> None:
        """Trim, thrust and step, and doubts about them."""
        self._findings += doubts.step_doubts(model)
        self._findings += doubts.inertia_doubts(model)

        self._findings += doubts.thruster_doubts(vehicle)
        if wet:
            doubted = [
                finding.said.partition(":")[0]
                for finding in self._findings
                if finding.code == "inertia"
            ]
            self._findings += [
                finding
                for finding in doubts.water_doubts(model, vehicle)
                # otherwise reported by the inertia already
                if finding.code != "coefficients" or finding.said.partition(":")[0] not in doubted
            ]

            self._findings += doubts.stiff_contact(model)
            self._findings += doubts.gravity_doubts(model, vehicle)
        # without coefficients of the hull, trim and currents have no meaning
        wet = wet and coefficients.carries(model.body_user[vehicle.hull])
        if wet:
            weight = weight_of(model, vehicle)
            trim = trim_of(model, vehicle)
            self._figure(
                "mass and trim",
                f"{float(model.body_subtreemass[model.body_rootid[vehicle.hull]]):.1f} kg, "
                f"{_trim_said(trim)} at home",
            )
            if vehicle.tip >= 0:
                self._figure("trim in ready", _trim_said(trim_of(model, vehicle, READY_KEY)))
            self._findings += doubts.trim_doubts(trim, weight)

        names = vehicle.thruster_names
        if names:
            rank = int(np.linalg.matrix_rank(vehicle.thruster_wrench, tol=1e-6))
            self._figure("thrusters", f"{len(names)}, rank {rank} of 6: {', '.join(names)}")

            # Limits along each axis, and the current that they hold.
            limits = []
            for i, axis in enumerate(AXES):
                back, ahead = authority(vehicle, i)
                unit = "N" if i < 3 else "N m"
                held = ""
                if i < 3 and wet:
                    speed = strongest_current(model, vehicle, i, min(back, ahead))
                    held = f" ({speed:.2f} m/s)" if speed < FASTEST else f" (> {FASTEST:g} m/s)"
                limits.append(f"{axis} -{back:.0f} to {ahead:.0f} {unit}{held}")

            self._figure("authority", "; ".join(limits[:3]))
            self._figure("", "; ".join(limits[3:]))
            if power := full_draw(model):
                self._figure("supply", power)

        if wet:
            rate = doubts.drag_rate(model)
            self._figure(
                "time step",
                f"{1e3 * model.opt.timestep:g} ms, {model.opt.timestep * rate:.0%} of the limit "
                f"by drag at {hydrodynamics.DRAG_SPEED:g} m/s",
            )

    def _arm(self, model: mujoco.MjModel, vehicle: Vehicle, wet: bool) -> float:
        """Reach, force and view of the arm, and doubts; returns the vehicle's share of the view."""
        search = PostureSearch(model)
        postures = {}
        for key in (HOME_KEY, READY_KEY):
            number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, key)
            if number >= 0:
                postures[key] = np.array(model.key_qpos[number][vehicle.qpos])

        limits = ", ".join(
            f"{name} {low:.2f} to {high:.2f} m {most:.3g} N"
            if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE
            else f"{name} {np.degrees(low):.0f} to {np.degrees(high):.0f} deg {most:.3g} N m"
            for j, name, most, (low, high) in zip(
                vehicle.joints,
                vehicle.joint_names,
                vehicle.torque_limits,
                vehicle.q_limits,
                strict=True,
            )
        )
        self._figure(f"{len(vehicle.joints)} joints", limits)

        home = postures.get(HOME_KEY, np.array(vehicle.q_home))
        self._findings += doubts.posture_doubts(search, postures)
        self._findings += doubts.tool_doubts(model, search, home)
        self._findings += doubts.view_doubts(search, home)
        self._findings += doubts.motor_doubts(model, vehicle)
        self._findings += doubts.light_joints(model, vehicle)

        X_BC = doubts.camera_pose(model, vehicle)
        share = seen_workspace(search, X_BC)
        self._figure(
            "reach",
            f"{search.reach:.2f} m from the arm's base; the tip reaches {share:.0%} of a ball of "
            "this diameter in front of the camera",
        )

        if wet:
            ready = np.array(vehicle.q_ready)
            force = tip_force(model, vehicle, ready)
            task = clean_barrel().task_of(SurfaceWorkTask)
            self._figure(
                "tip force",
                f"ready posture: {force.along:.0f} N along the tool (limit: {force.by}), "
                f"{force.weakest:.0f} N in the weakest direction (limit: {force.weakest_by}); "
                f"stiction masks {force.friction:.0f} N; own weight uses {force.load.max():.0%} "
                f"of the torque of {vehicle.joint_names[int(np.argmax(force.load))]}",
            )
            self._findings += doubts.arm_doubts(
                vehicle, force, max(self._jobs.conditions.forces or task.forces)
            )

        return search.view_hits(home, doubts.HALF_VIEW)[0]

    def _verdict(
        self, job: str, model: mujoco.MjModel, vehicle: Vehicle | None, blocked: float
    ) -> JobVerdict:
        if vehicle is None:
            faults = [finding for finding in self._findings if finding.level == "fault"]
            message = faults[0].said if faults else "the model is no vehicle by the contract"
            code = faults[0].code if faults else "parts"
            return JobVerdict(job=job, promised=False, code=code, said=message)

        if not vehicle.thruster_names:
            bare = any(line.startswith(BARE_ARM) for line in computed(self._spec).values())
            reason = f"{BARE_ARM}: {MOUNT}" if bare else "lacks thrusters (hold the hull)"
            return JobVerdict(job=job, promised=False, code="parts", said=reason)

        for fault in self._findings:
            if fault.level == "fault" and (job in ARM_JOBS or fault.code not in _OF_ARM):
                return JobVerdict(
                    job=job, promised=False, code=fault.code, said=fault.said, figure=fault.figure
                )

        closed = loops(self._spec)
        if job in HOVERING:
            current = HOVERING[job]
            if any(current) and self._jobs.conditions.current is not None:
                current = self._jobs.conditions.current
            return hover_verdict(job, rigid(self._spec, model) if closed else model, current)
        if closed:
            reason = f"the arm is a closed loop ({closed[0]}), and jobs support serial arms only"
            return JobVerdict(job=job, promised=False, code="closed-loop", said=reason)
        assert job in ARM_JOBS
        return self._jobs.verdict(job, blocked)


def _trim_said(trim: Trim) -> str:
    tilt = (
        "no stable attitude"
        if math.isnan(trim.roll)
        else (f"list {np.degrees(trim.roll):+.1f} deg, trim {np.degrees(trim.pitch):+.1f} deg")
    )
    return (
        f"{trim.force:+.1f} N, {tilt}, centre of buoyancy {1e3 * trim.height:.0f} mm above the "
        "centre of mass"
    )
