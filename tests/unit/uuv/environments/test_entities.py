"""dm_control's physics under the entities is the plant bit for bit, and nothing leaks between
episodes.
"""

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

if find_spec("gymnasium") is None:  # nor is the rest of the extra `rl`
    pytest.skip("dm_control is not here", allow_module_level=True)

# isort: skip  # before dm_control, for which it chooses a renderer
import gymnasium
import mujoco
import trimesh
from dm_control import composer, mjcf
from dm_control.composer.observation import observable

from untyped import untyped
from uuv import environments as uuv
from uuv.environments import suite
from uuv.environments.actions import ThrustersAndTorques
from uuv.environments.entities import put
from uuv.environments.mjcf_parts import parts_of
from uuv.environments.vehicle_task import VehicleTask
from uuv.models import hydrodynamics as hydrodynamic_rows
from uuv.models.files import sidecar
from uuv.models.objects import targets
from uuv.models.water.forms import LiftDrag, MunkFactor
from uuv.own_vehicle import vehicle_spec
from uuv.perturbations.pad import Pad
from uuv.perturbations.target import MovingObject
from uuv.perturbations.vehicle import Gears, Payload, ThrusterSpread, Water
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, PhysicsWarning
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors.proprioception import Dvl, Encoders, Imu
from uuv.sim.water.current import Current


class Drift(VehicleTask):
    """Nothing to do."""

    def __init__(
        self, vehicle: uuv.VehicleEntity, sea: uuv.Sea | None = None, X_WB: Array | None = None
    ) -> None:
        super().__init__(sea or uuv.Sea(0.2, gust=0.05), vehicle, ThrustersAndTorques(vehicle.own))
        self.start = pose() if X_WB is None else X_WB

    @property
    def judge(self) -> Any:
        """Is never asked."""
        return untyped(Never())

    def begin(self, random_state: np.random.RandomState) -> tuple[Array, None]:
        return self.start, None

    def goal(self, truth: Any) -> dict[str, Array]:
        return {}

    def shaped(self, truth: Any) -> float:
        return 0.0


class Never:
    done = False
    failed = ""

    def start(self) -> None: ...

    def watch(self, truth: Any, dt: float) -> None: ...


def environment(task: composer.Task, seed: int = 0) -> composer.Environment:
    return composer.Environment(
        task,
        random_state=seed,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=False,
    )


def actions(count: int, size: int, seed: int = 1) -> Array:
    rng = np.random.default_rng(seed)
    return np.clip(rng.uniform(-0.5, 0.5, size) + rng.uniform(-0.3, 0.3, (count, size)), -1.0, 1.0)


def states(env: composer.Environment, commands: Array) -> Array:
    """State after each action of one episode, positions and velocities."""
    env.reset()
    rows = []
    for command in commands:
        env.step(command)
        rows.append(np.concatenate([env.physics.data.qpos, env.physics.data.qvel]))
    return np.array(rows)


@pytest.mark.parametrize(
    ("vehicle", "tool"),
    [
        ("uuv_puma", None),
        ("uuv_puma", "sampler"),
        ("uuv_puma_side", None),
        ("uuv_puma_side", "jaws"),  # whose tendon goes with the tool
        ("bluerov2_heavy_alpha5", None),  # its arm ends in a bare tip
        ("bluerov2_heavy_alpha5", "small_pad"),
        ("bluerov2_heavy", None),  # has no arm
    ],
)
def test_is_the_plant_bit_for_bit(vehicle: str, tool: str | None):
    X_WB = pose(exp_so3([0.05, -0.1, 0.7]), [0.3, -0.2, 0.1])
    task = Drift(uuv.VehicleEntity(vehicle, tool=tool), X_WB=X_WB)
    size = len(task.actions.names)
    env = environment(task)
    commands = actions(25, size)
    by_dm_control = states(env, commands)
    plant = Plant(
        hydrodynamics.compile(vehicle_spec(vehicle, tool)),
        current=task.sea.flow(env.physics.timestep()),
        X_WB=X_WB,
    )
    plant.observe()
    kind = untyped(task.actions)
    for action, row in zip(commands, by_dm_control, strict=True):
        for _ in range(round(env.control_timestep() / plant.timestep)):
            kind.take(action, 0.02)
            plant.step(kind.command(plant.truth))
            plant.observe()
        np.testing.assert_array_equal(np.concatenate([plant.data.qpos, plant.data.qvel]), row)
    for name in (
        "propeller_speed",
        "thrust",
        "tau_friction",
        "tau_drive",
        "current_W",
        "acceleration",
        "p_WG",
    ):
        np.testing.assert_array_equal(
            getattr(task.truth, name), getattr(plant.truth, name), err_msg=name
        )
    assert np.linalg.norm(plant.truth.v_WB_W) > 0.02
    assert plant.truth.current_W.any()


def test_contact_is_that_of_the_plant():
    """The pad presses on a barrel: contact forces of every step, not of the next one's
    constraints.
    """
    target = targets.barrel()
    X_WT = pose(p=[0.0, 0.0, -1.6])
    vehicle = uuv.VehicleEntity("uuv_puma")
    sea = uuv.Sea(depth=2.4)
    task = Drift(vehicle, sea)
    put(sea, uuv.WorkObjectEntity(target), X_WT)
    env = environment(task)
    env.reset()
    spec = vehicle_spec("uuv_puma")
    target.add_to(spec, X_WT)
    spec.worldbody.add_geom(
        name="seabed",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[12.0, 12.0, 0.1],
        pos=[0.0, 0.0, -2.4],
    )
    plant = Plant(hydrodynamics.compile(spec), current=Current(np.zeros(3)))
    plant.observe()
    down = np.zeros(12)
    down[3:6] = -1.0  # heave
    down[7:9] = [0.3, -0.3]
    pressed = 0.0
    for _ in range(120):
        env.step(down)
        for _ in range(10):
            task.actions.take(down, 0.02)
            plant.step(task.actions.command(plant.truth))
            plant.observe()
        truth = task.truth
        assert truth.contact_normal == pytest.approx(plant.truth.contact_normal, abs=1e-6)
        np.testing.assert_allclose(truth.contact_force_W, plant.truth.contact_force_W, atol=1e-6)
        assert truth.collision == plant.truth.collision
        pressed = max(pressed, truth.contact_normal, float(truth.collision))
        if truth.collision:
            break
    assert pressed > 0.0, "nothing touched"


def test_episodes_repeat_under_a_seed_and_leave_nothing_behind():
    env = environment(Drift(uuv.VehicleEntity("uuv_puma")))
    commands = actions(20, 12)
    runs = []
    for seed in (3, 3, 4):
        env.random_state.seed(seed)
        runs.append(states(env, commands))
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_a_copied_state_goes_on_as_the_original():
    """Positions, velocities and propellers are in MjData; a steady current is in the model."""
    env = environment(Drift(uuv.VehicleEntity("uuv_puma"), uuv.Sea(current_W=(0.1, 0.0, 0.0))))
    commands = actions(20, 12)
    env.reset()
    for command in commands[:10]:
        env.step(command)
    state = env.physics.get_state(mujoco.mjtState.mjSTATE_INTEGRATION.value)
    ends = []
    for _ in range(2):
        env.physics.set_state(state, mujoco.mjtState.mjSTATE_INTEGRATION.value)
        env.physics.forward()
        for command in commands[10:]:
            env.step(command)
        ends.append(env.physics.data.qpos.copy())
    # `forward` starts the solver anew: 2e-15
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-13)
    copied = env.physics.copy(share_model=True)
    np.testing.assert_array_equal(copied.data.act, env.physics.data.act)
    assert env.physics.data.act.any()


def test_two_environments_in_one_process_do_not_mix():
    commands = actions(15, 12)
    alone = [
        states(environment(Drift(uuv.VehicleEntity("uuv_puma")), seed), commands) for seed in (0, 1)
    ]
    both = [environment(Drift(uuv.VehicleEntity("uuv_puma")), seed) for seed in (0, 1)]
    for env in both:
        env.reset()
    for k, command in enumerate(commands):
        for env, expected in zip(both, alone, strict=True):
            env.step(command)
            np.testing.assert_array_equal(
                np.concatenate([env.physics.data.qpos, env.physics.data.qvel]), expected[k]
            )


def test_a_vehicle_of_a_users_file_with_a_mesh(tmp_path):
    """Names of files are relative to the model's own folder, also for the parts that are taken
    apart.

    It has no keyframes: that of the folded arm is found.
    """
    trimesh.creation.box((0.4, 0.3, 0.2)).export(tmp_path / "frame.obj")
    spec = vehicle_spec("uuv_puma")
    spec.add_mesh(name="frame", file="frame.obj")
    spec.body("hull").add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname="frame", contype=0, conaffinity=0, mass=0
    )
    spec.modelfiledir = str(tmp_path)
    for key in list(spec.keys):
        spec.delete(key)
    file = tmp_path / "mine.xml"
    file.write_text(spec.to_xml())
    task = Drift(uuv.VehicleEntity(str(file)), uuv.Sea(current_W=(0.1, 0.0, 0.0)))
    commands = actions(5, 12)
    by_dm_control = states(environment(task), commands)
    plant = Plant(hydrodynamics.compile(vehicle_spec(str(file))), current=task.sea.flow(0.002))
    plant.observe()
    for action in commands:
        for _ in range(10):
            task.actions.take(action, 0.02)
            plant.step(task.actions.command(plant.truth))
            plant.observe()
    np.testing.assert_array_equal(plant.data.qpos, by_dm_control[-1][: plant.model.nq])


def test_a_vehicle_with_forms_in_a_sidecar_is_the_plant(tmp_path):
    """Records behind the rows of bodies pass through PyMJCF, which joins the parts and a dry
    sea.
    """
    spec = vehicle_spec("uuv_puma")
    wet = hydrodynamic_rows.attached(spec)
    forms = (
        MunkFactor(factor=np.array([1.0, 0.3, 0.2])),
        LiftDrag.of_wing(area=0.2, span=0.5, drag_0=0.1),
    )
    hydrodynamic_rows.attach(
        spec, {name: replace(wet[name], forms=forms) for name in ("hull", "link3")}
    )
    file = tmp_path / "mine.xml"
    file.write_text(sidecar.xml_without_water(spec))
    sidecar.write_sidecar(spec, sidecar.beside(file))
    task = Drift(uuv.VehicleEntity(str(file)), uuv.Sea(current_W=(0.3, 0.2, 0.0)))
    commands = actions(5, 12)
    by_dm_control = states(environment(task), commands)
    positions = []
    for vehicle in (str(file), "uuv_puma"):
        plant = Plant(hydrodynamics.compile(vehicle_spec(vehicle)), current=task.sea.flow(0.002))
        plant.observe()
        for action in commands:
            for _ in range(10):
                task.actions.take(action, 0.02)
                plant.step(task.actions.command(plant.truth))
                plant.observe()
        positions.append(np.array(plant.data.qpos))
    np.testing.assert_array_equal(positions[0], by_dm_control[-1][: len(positions[0])])
    assert np.max(np.abs(positions[0] - positions[1])) > 1e-6  # the forms act


def test_named_access_and_parts():
    vehicle = uuv.VehicleEntity("uuv_puma")
    env = environment(Drift(vehicle))
    env.reset()
    named = env.physics.named.data
    assert named.xpos["vehicle/hull"].shape == (3,)
    np.testing.assert_array_equal(named.site_xpos["vehicle/arm/tool/tip"], vehicle.truth.p_WG)
    assert vehicle.arm is not None
    assert len(vehicle.arm.joints) == len(vehicle.arm.actuators) == 6
    bound = env.physics.bind(vehicle.arm.joints)
    np.testing.assert_array_equal(bound.qpos, vehicle.truth.q)


def test_an_arm_stands_on_a_base_of_another():
    """The arm of a vehicle on a plain pedestal, with the tool of that vehicle: a model that
    compiles and is wet.
    """
    root = mjcf.RootElement(model="deck")
    root.compiler.angle = "radian"
    site = root.worldbody.add("site", name="top", pos=[0, 0, 1])
    arm = uuv.ArmEntity("uuv_puma")
    site.attach(arm.mjcf_model)
    physics = mjcf.Physics.from_mjcf_model(root)
    assert physics.model.nu == 6
    assert hydrodynamics.carries_hydrodynamics(physics.model.ptr)
    assert arm.tool is not None


def test_parts_that_are_tied_together_stay_in_one_piece():
    spec = vehicle_spec("uuv_puma")
    spec.add_exclude(bodyname1="hull", bodyname2="link3")
    parts = parts_of(spec)
    assert parts.arm is None
    assert parts.tool is None
    assert "link3" in parts.hull


def test_what_ties_a_gripper_s_fingers_goes_with_the_tool():
    parts = parts_of(vehicle_spec("uuv_puma", tool="gripper"))
    assert parts.arm is not None
    assert parts.tool is not None
    for section in ("<tendon", "<equality"):
        assert section in parts.tool
        assert section not in parts.hull
        assert section not in parts.arm


SPREADS = (
    Water(spread=0.3),
    Payload(spread=0.1),
    ThrusterSpread(gain=0.2),
    Gears(spread=0.3),
    Pad(friction=0.2),
)


def test_perturbations_are_drawn_anew_in_each_episode():
    env = environment(Drift(uuv.VehicleEntity("uuv_puma", perturbations=SPREADS)))
    commands = actions(10, 12)
    rows = []
    models = []
    for seed in (1, 1, 2):
        env.random_state.seed(seed)
        rows.append(states(env, commands))
        model = env.physics.model.ptr
        models.append(
            [
                model.body_user.copy(),
                model.body_mass.copy(),
                model.actuator_user.copy(),
                model.dof_damping.copy(),
            ]
        )
    np.testing.assert_array_equal(rows[0], rows[1])
    assert not np.array_equal(rows[0], rows[2])
    for first, other in zip(models[0], models[2], strict=True):
        assert not np.array_equal(first, other)


def test_a_perturbed_episode_is_the_perturbed_plant():
    """The same draw, compiled by itself, moves alike to the bit."""
    from uuv.perturbations.perturbation import perturb

    task = Drift(uuv.VehicleEntity("uuv_puma", perturbations=SPREADS[:4]), uuv.Sea())
    env = environment(task)
    env.random_state.seed(7)
    commands = actions(10, 12)
    by_dm_control = states(env, commands)
    drawing = np.random.RandomState(7)
    drawing.uniform(-np.pi, np.pi)  # as the sea draws before
    drawing.randint(2**31)
    spec = vehicle_spec("uuv_puma")
    perturb(spec, SPREADS[:4], int(drawing.randint(2**31)))
    plant = Plant(hydrodynamics.compile(spec), current=Current(np.zeros(3)))
    plant.observe()
    for action in commands:
        for _ in range(10):
            task.actions.take(action, 0.02)
            plant.step(task.actions.command(plant.truth))
            plant.observe()
    np.testing.assert_array_equal(plant.data.qpos, by_dm_control[-1][: plant.model.nq])


def sensed(sensors: Sequence[Any]) -> composer.Environment:
    return environment(
        Drift(uuv.VehicleEntity("uuv_puma", sensors=sensors), uuv.Sea(current_W=(0.1, 0.0, 0.0)))
    )


def test_sensors_are_observed_at_their_rates_and_delays():
    env = sensed([Dvl(), Encoders(delay=0.04)])
    first = env.reset().observation
    assert set(first) == {"vehicle/dvl_v_WB_B", "vehicle/encoders_q", "vehicle/encoders_qd"}
    observations = [env.step(action).observation for action in actions(30, 12)]
    speeds = np.array([observation["vehicle/dvl_v_WB_B"] for observation in observations])
    changes = np.flatnonzero(np.any(np.diff(speeds, axis=0) != 0.0, axis=1))
    np.testing.assert_array_equal(np.diff(changes), 5)  # every 0.1 s, at 0.02 s per action
    env.reset()
    late, true = [], []
    for action in actions(30, 12):
        late.append(env.step(action).observation["vehicle/encoders_q"])
        true.append(env.task.truth.q.copy())
    # two actions later, 19 bits
    np.testing.assert_allclose(np.array(late)[2:], np.array(true)[:-2], atol=2e-5)


def test_noise_is_that_of_the_sensor():
    env = sensed([Imu(acceleration_bias=0.0, attitude_bias=0.0), Dvl(period=0.02, noise=0.01)])
    env.reset()
    errors = []
    for _ in range(400):
        velocity = env.step(np.zeros(12)).observation["vehicle/dvl_v_WB_B"]
        truth = env.task.truth
        errors.append(velocity - truth.R_WB.T @ truth.v_WB_W)
    assert np.std(errors) == pytest.approx(0.01, rel=0.1)
    assert abs(np.mean(errors)) < 0.002


def test_readings_of_one_message_are_of_one_sample():
    env = sensed([Imu()])
    env.reset()
    env.step(np.zeros(12))
    vehicle = untyped(env.task.vehicle)
    message = vehicle.readings.read(0, vehicle.truth)
    assert vehicle.readings.read(0, vehicle.truth) is message


def test_an_observable_of_your_own():
    vehicle = uuv.VehicleEntity("uuv_puma")
    task = Drift(vehicle)
    height = observable.Generic(lambda physics: physics.named.data.xpos["vehicle/hull", ["z"]])
    vehicle.observables.add_observable("height", height)
    env = environment(task)
    assert env.reset().observation["vehicle/height"] == pytest.approx(0.0)
    assert env.step(np.r_[np.zeros(3), np.ones(3), np.zeros(6)]).observation["vehicle/height"] > 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: uuv.VehicleEntity("submarine"), "unknown vehicle 'submarine'"),
        (lambda: uuv.VehicleEntity("reach_alpha_5"), "must have a body 'hull'"),
        (
            lambda: uuv.VehicleEntity("uuv_puma", sensors=[Dvl(), Dvl(noise=0.1)]),
            "one of each class only, got Dvl, Dvl",
        ),
        (
            lambda: uuv.VehicleEntity("uuv_puma", perturbations=[MovingObject()]),
            "MovingObject: must act on the vehicle only",
        ),
        (lambda: uuv.ArmEntity("bluerov2_heavy"), "must have a detachable arm"),
        (lambda: uuv.Sea(-0.1), "speed of the current"),
        (lambda: uuv.Sea(depth=0.0), "depth"),
        (lambda: uuv.VehicleEntity("uuv_puma").plant, "has no physics yet"),
    ],
)
def test_refuses(make: Any, message: str):
    with pytest.raises(ConfigurationError, match=message):
        make()


def test_an_arm_alone_knows_no_true_state():
    arm = uuv.ArmEntity("uuv_puma")
    with pytest.raises(ConfigurationError, match="arm: must be attached to a vehicle"):
        arm.observables.joints(None)


def test_one_vehicle_a_sea():
    sea = uuv.Sea()
    sea.add_free_entity(uuv.VehicleEntity("uuv_puma", name="one"))
    with pytest.raises(ConfigurationError, match="must have one vehicle only"):
        sea.add_free_entity(uuv.VehicleEntity("uuv_puma", name="two"))


def test_a_dry_prop_is_told():
    sea = uuv.Sea()
    task = Drift(uuv.VehicleEntity("uuv_puma"), sea)
    ball = mjcf.RootElement(model="ball")
    ball.worldbody.add("geom", size=[0.1])
    sea.mjcf_model.worldbody.attach(ball).add("freejoint")
    with pytest.warns(PhysicsWarning, match="the body 'ball/' floats without hydrodynamics"):
        environment(task)


def test_a_delayed_sensor_begins_with_its_first_reading():
    env = uuv.environment(
        Drift(uuv.VehicleEntity("uuv_puma", sensors=[Encoders(delay=0.04)])), seed=0
    )
    vehicle = untyped(env.task.vehicle)
    np.testing.assert_allclose(
        env.reset().observation["vehicle/encoders_q"], vehicle.own.vehicle.q_home, atol=2e-5
    )


def test_a_stiff_pad_needs_another_timestep_and_is_refused():
    env = environment(Drift(uuv.VehicleEntity("uuv_puma", perturbations=[Pad(stiffness=1e6)])))
    with pytest.raises(ConfigurationError, match="must not need another timestep"):
        env.reset()


def test_a_command_reaches_the_thrusters_of_a_vehicle_outside_a_task():
    """Entities alone, without a task of ours."""
    sea = uuv.Sea()
    vehicle = uuv.VehicleEntity("uuv_puma")
    sea.add_free_entity(vehicle)

    class Plain(composer.Task):
        @property
        def root_entity(self) -> uuv.Sea:
            return sea

        def get_reward(self, physics: mjcf.Physics) -> float:
            return 0.0

        def action_spec(self, physics: mjcf.Physics) -> Any:
            from dm_env import specs

            return specs.BoundedArray((0,), np.float64, 0.0, 1.0)

        def before_step(self, physics: mjcf.Physics, action: Array, random_state: Any) -> None: ...

        def initialize_episode(self, physics: mjcf.Physics, random_state: Any) -> None:
            vehicle.place(physics)

    task = Plain()
    task.set_timesteps(0.02, 0.002)
    env = environment(task)
    env.reset()
    vehicle.command = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.ones(6), scan=False)
    for _ in range(20):
        env.step(np.zeros(0))
    assert vehicle.truth.p_WB[2] > 0.005


def test_names_with_slashes_and_dots_change_nothing(tmp_path: Path) -> None:
    """As in the URDFs of ROS, with namespaces; two names differ by the slash alone."""
    xml = sidecar.xml_with_elements(vehicle_spec("uuv_puma"))
    renamed = {
        "link2": "ns/link.2",
        "joint3": "ns/j.3",
        "joint4": "ns_j.3",
        "joint5": "a.b",
        "thruster_sway": "thr/s.way",
    }
    for before, after in renamed.items():
        assert before in xml
        xml = xml.replace(before, after)
    file = tmp_path / "scoped.xml"
    file.write_text(xml, encoding="utf-8")

    states = []
    for vehicle in ("uuv_puma", str(file)):
        spread = (Gears(spread=0.3), Water(spread=0.2))
        environment = suite.load("water/reach", vehicle=vehicle, seed=3, perturbations=spread)
        environment.reset()
        rng = np.random.default_rng(1)
        for _ in range(5):
            environment.step(rng.uniform(-1.0, 1.0, environment.action_spec().shape))
        states.append(np.array(environment.physics.data.qpos))
    np.testing.assert_array_equal(*states)
    model = environment.physics.model.ptr
    names = {model.joint(j).name for j in range(model.njnt)}
    assert {"vehicle/arm/ns_j.3_2", "vehicle/arm/ns_j.3", "vehicle/arm/a.b"} <= names
    assert float(np.abs(states[0][7:]).max()) > 0.01


def test_a_task_takes_a_vehicle_with_another_tool() -> None:
    """A vehicle whose arm has none of its own is given one, in dm_control and in Gymnasium."""
    made = suite.load("water/reach", vehicle="bluerov2_heavy_alpha5", tool="small_pad", seed=0)
    assert "vehicle/arm/tool/contact_force" in made.reset().observation
    gym_made = gymnasium.make(
        "uuv.environments.gym_tasks:uuv/Reach-v0", vehicle="bluerov2_heavy_alpha5", tool="small_pad"
    )
    observation, _ = gym_made.reset(seed=0)
    assert "vehicle/arm/tool/contact_force" in observation
    gym_made.close()
    with pytest.raises(ConfigurationError, match=r"unknown tool 'hammer'"):
        suite.load("water/reach", tool="hammer")
