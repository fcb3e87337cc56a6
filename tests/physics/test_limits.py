"""What runs dry, frozen, past its limits or on a likely slip says so; what is fine stays silent."""

import copy
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import LAYOUT, BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError, PhysicsWarning
from uuv.sim.interfaces.messages import Command
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

pytestmark = pytest.mark.filterwarnings("error::uuv.sim.interfaces.errors.PhysicsWarning")

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody> <body name="ball"><freejoint/><geom size=".1" mass="3"/></body> </worldbody>
</mujoco>
"""
ARM = """
<mujoco>
  <worldbody>
    <body name="hull"> <freejoint/> <geom size=".2" mass="30"/> <site name="root"/>
      <body name="link" pos=".3 0 0"> <joint name="j" axis="0 1 0"/> <geom size=".1" mass="3"/>
        <site name="wrist"/>
        <body name="tool" pos=".2 0 0"> <joint name="k" axis="0 1 0"/> <geom size=".05" mass="1"/>
          <site name="tip"/>
          <body name="mount"> <joint type="slide" stiffness="1e3"/>
            <inertial pos="0 0 0" mass=".1" diaginertia="1 1 1"/>
          </body>
        </body>
      </body>
    </body>
    <body name="crate" pos="5 0 0"> <freejoint/> <geom size=".1" mass="3"/> <site name="lid"/>
      </body>
  </worldbody>
  <sensor> {sensors} </sensor>
</mujoco>
"""
WET = {"hull": water.sphere(0.2), "link": water.sphere(0.1), "tool": water.sphere(0.05)}


def ball(body: BodyHydrodynamics | None = None) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(BALL)
    water.attach(spec, {"ball": body or water.sphere(0.1)})
    return hydrodynamics.compile(spec)


def arm(bodies: dict[str, BodyHydrodynamics] = WET, sensors: str = "") -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(ARM.format(sensors=sensors))
    water.attach(spec, bodies)
    return hydrodynamics.compile(spec)


def after(model: mujoco.MjModel, steps: int) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, steps)
    return data


def new_plant() -> Plant:
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=Current(np.zeros(3)))
    plant.observe()
    return plant


def still(plant: Plant) -> Command:
    vehicle = plant.vehicle
    return Command(
        time=0.0,
        joint_torque=np.zeros(6),
        thrusters=np.zeros(len(vehicle.thruster_names)),
        scan=False,
    )


# -- dry -------------------------------------------------------------------------------------------


def test_a_pickled_model_brings_its_water_into_a_new_process(root: Path, tmp_path: Path):
    """As multiprocessing's spawn and forkserver hand it over; data carries its model."""
    model = ball()
    (tmp_path / "wet.pkl").write_bytes(pickle.dumps([model, after(model, 1)]))
    code = f"""
import mujoco, pickle
model, data = pickle.load(open({str(tmp_path / "wet.pkl")!r}, "rb"))
mujoco.mj_step(model, data, 99)
print(repr(float(data.qvel[2])))
"""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    assert float(run.stdout) == after(model, 100).qvel[2] > 0.1


def test_pickle_leaves_dry_models_and_copies_alone():
    dry = mujoco.MjModel.from_xml_string(BALL)
    hydrodynamics.uninstall()
    for again in (pickle.loads(pickle.dumps(dry)), copy.deepcopy(dry)):
        assert again.nq == dry.nq
    pickle.loads(pickle.dumps(after(dry, 1)))
    assert mujoco.get_mjcb_passive() is None


def test_an_mjb_brings_its_water_into_a_new_process(root: Path, tmp_path: Path):
    """As a spawned worker loads it, which has imported the module of the function that it runs."""
    model = ball()
    mujoco.mj_saveModel(model, str(tmp_path / "wet.mjb"))
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(BALL), str(tmp_path / "dry.mjb"))
    code = f"""
import mujoco
from uuv.sim import hydrodynamics
mujoco.MjModel.from_binary_path({str(tmp_path / "dry.mjb")!r})
print(mujoco.get_mjcb_passive())
model = mujoco.MjModel.from_binary_path({str(tmp_path / "wet.mjb")!r})
data = mujoco.MjData(model)
mujoco.mj_step(model, data, 100)
print(repr(float(data.qvel[2])))
"""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == ["None", repr(float(after(model, 100).qvel[2]))]


def test_a_loaded_file_is_refused_where_the_callback_is_not_installed(tmp_path: Path):
    mujoco.mj_saveModel(ball(), str(tmp_path / "wet.mjb"))
    model = mujoco.MjModel.from_binary_path(str(tmp_path / "wet.mjb"))
    hydrodynamics.uninstall()
    for refuse in (hydrodynamics.check, hydrodynamics.set_constants):
        with pytest.raises(
            HydrodynamicsError,
            match=r"moves dry: call "
            r"uuv\.sim\.hydrodynamics\.install\(\)",
        ):
            refuse(model)
    with pytest.raises(HydrodynamicsError, match="moves dry"):
        hydrodynamics.check_wet(model, after(model, 1))
    hydrodynamics.install()
    hydrodynamics.check_wet(model, after(model, 1))


def test_compile_installs_the_callback_for_what_is_wet():
    hydrodynamics.uninstall()
    hydrodynamics.compile(mujoco.MjSpec.from_string(BALL))
    assert not hydrodynamics.is_installed()
    assert after(ball(), 100).qvel[2] > 0.1


@pytest.mark.parametrize("other", [None, lambda _model, _data: None], ids=["removed", "replaced"])
def test_another_callback_in_its_place_is_told_of_at_once(other):
    model, plant = ball(), new_plant()
    plant.step(still(plant))
    plant.observe()
    try:
        with pytest.warns(
            RuntimeWarning, match="was replaced or removed: .* move without water"
        ) as warned:
            mujoco.set_mjcb_passive(other)
        assert warned[0].filename == __file__
        assert not hydrodynamics.is_installed()
        with pytest.raises(HydrodynamicsError, match="moves dry"):
            hydrodynamics.check(model)
        plant.step(still(plant))
        with pytest.raises(HydrodynamicsError, match="moves dry"):
            plant.observe()
        if other:
            with pytest.raises(HydrodynamicsError, match="another passive callback"):
                ball()
    finally:
        mujoco.set_mjcb_passive(None)
    hydrodynamics.install()
    plant.observe()


def test_flags_that_keep_mujoco_from_calling_are_met_in_the_plant():
    plant = new_plant()
    flags = mujoco.mjtDisableBit
    plant.model.opt.disableflags = int(flags.mjDSBL_SPRING | flags.mjDSBL_DAMPER)
    plant.step(still(plant))
    with pytest.raises(HydrodynamicsError, match="moved dry: MuJoCo did not call"):
        plant.observe()


def test_sensors_that_do_not_see_the_water_are_named():
    sensors = '<force name="{0}f" site="{0}"/> <torque name="{0}t" site="{0}"/>'
    fine = (
        '<accelerometer site="tip"/> <touch site="tip"/> <jointactuatorfrc joint="j"/>'
        + sensors.format("lid")
    )
    arm(sensors=fine)  # the crate is dry
    with pytest.warns(
        PhysicsWarning,
        match=r"do not see the water: wristf, wristt; .* "
        r"uuv\.sim\.plant\.reaction",
    ):
        arm(sensors=fine + sensors.format("wrist"))


def test_sensors_that_are_not_named_read_true():
    """An accelerometer reads what the motion shows: acceleration of its site less gravity, in its
    own axes.
    """
    model = arm(sensors='<accelerometer site="tip"/>')
    data = after(model, 200)
    data.qvel[:8] = [0.3, -0.2, 0.1, 0.2, 0.3, -0.4, 1.0, -2.0]
    mujoco.mj_forward(model, data)
    h = 1e-6
    site = model.site("tip").id
    J = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, J, None, site)
    v = J @ data.qvel
    R = data.site_xmat[site].reshape(3, 3).copy()
    read = data.sensordata.copy()
    mujoco.mj_integratePos(model, data.qpos, data.qvel, h)
    data.qvel += h * data.qacc
    mujoco.mj_forward(model, data)
    mujoco.mj_jacSite(model, data, J, None, site)
    expected = R.T @ ((J @ data.qvel - v) / h - model.opt.gravity)
    np.testing.assert_allclose(read, expected, atol=1e-4)  # measured 3e-6
    assert np.linalg.norm(expected - R.T @ [0.0, 0.0, 9.81]) > 0.5


# -- frozen, past its limits -----------------------------------------------------------------------


def test_a_step_without_observe_is_refused():
    plant = new_plant()
    plant.step(still(plant))
    with pytest.raises(
        ConfigurationError, match=r"observe\(\) must be called before each step\(\)"
    ):
        plant.step(still(plant))
    plant.observe()
    plant.reset(current=Current(np.zeros(3)))
    with pytest.raises(ConfigurationError, match="observe"):
        plant.step(still(plant))


@pytest.mark.parametrize("body", ["hull", "link", "tool"])
def test_an_indefinite_added_mass_at_run_time_is_refused(body: str):
    model = arm()
    data = after(model, 5)
    hydrodynamics.check_motion(model, data)
    diagonal = LAYOUT.added_mass + np.array([0, 6, 11])
    model.body_user[model.body(body).id, diagonal] = -100.0
    mujoco.mj_forward(model, data)
    assert data.warning[mujoco.mjtWarning.mjWARN_INERTIA].number > 0
    with pytest.raises(HydrodynamicsError, match=r"not positive definite near t = 0\.01 s"):
        hydrodynamics.check_motion(model, data)
    with pytest.raises(ConfigurationError, match="negative eigenvalue"):
        hydrodynamics.set_constants(model)
    model.body_user[model.body(body).id, diagonal] = 1.0
    hydrodynamics.set_constants(model)
    hydrodynamics.check_motion(model, after(model, 5))


def test_the_plant_refuses_an_indefinite_added_mass():
    plant = new_plant()
    plant.model.body_user[plant.vehicle.hull, LAYOUT.added_mass] = -1e4
    plant.step(still(plant))
    with pytest.raises(HydrodynamicsError, match="not positive definite"):
        plant.observe()


@pytest.fixture
def said(capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture) -> Callable[[], str]:
    """MuJoCo's warnings since the last call; where dm_control has been imported they go to its
    log.
    """

    def text() -> str:
        output = capfd.readouterr().err + caplog.text
        caplog.clear()
        return output

    return text


def test_rising_above_the_water_is_told_once(said: Callable[[], str], tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo's log
    model = ball()
    data = after(model, 1)
    data.qpos[2] = water.CEILING - 0.01
    mujoco.mj_forward(model, data)
    hydrodynamics.check_motion(model, data)
    assert not said()
    data.qpos[2] += 0.02
    mujoco.mj_step(model, data, 5)
    message = said()
    assert message.count("risen above z = 0") == 1
    assert "no free surface" in message
    with pytest.warns(PhysicsWarning, match="rose more than 10 m above z = 0"):
        hydrodynamics.check_motion(model, data)
    mujoco.mj_step(model, data)
    hydrodynamics.check_motion(model, data)
    assert not said()


def test_without_weight_there_is_no_above(said: Callable[[], str]):
    model = ball()
    model.opt.gravity = 0.0
    data = mujoco.MjData(model)
    data.qpos[2] = 1e3
    mujoco.mj_step(model, data)
    hydrodynamics.check_motion(model, data)
    assert not said()


def test_the_plant_tells_of_what_was_met(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = new_plant()
    plant.data.qpos[2] = 20.0
    plant.step(still(plant))
    with pytest.warns(PhysicsWarning, match="above z = 0"):
        plant.observe()
    plant.step(still(plant))
    plant.observe()


@pytest.mark.parametrize(
    ("speed", "timestep", "tells"),
    [(9.9, 0.002, False), (10.1, 0.002, True), (4.9, 0.004, False), (5.1, 0.004, True)],
)
def test_drag_beyond_what_the_step_was_judged_for_is_told(
    speed, timestep, tells, said, tmp_path, monkeypatch
):
    """3 kg and 75 |v| N make a slope of 150 |v| / 3 1/s: 500 1/s at 10 m/s, 250 1/s at 5 m/s."""
    monkeypatch.chdir(tmp_path)
    model = ball(
        BodyHydrodynamics(
            volume=0.003, quadratic_damping=np.array([75.0, 75.0, 75.0, 0.0, 0.0, 0.0])
        )
    )
    model.opt.timestep = timestep
    model.opt.wind = [0.5, 0.0, 0.0]  # it is the speed through the water that counts
    data = mujoco.MjData(model)
    data.qvel[0] = 0.5 - speed
    mujoco.mj_forward(model, data)
    assert ("faster than its drag was judged for" in said()) is tells
    if not tells:
        hydrodynamics.check_motion(model, data)
        return
    with pytest.warns(
        PhysicsWarning, match=f"faster than {0.02 / timestep:g} m/s .* timestep of {timestep:g} s"
    ):
        hydrodynamics.check_motion(model, data)
    hydrodynamics.check_motion(model, data)


def test_whichever_of_several_bodies_is_too_fast_or_too_high_is_told(
    said: Callable[[], str], tmp_path: Path, monkeypatch
):
    """Bodies are worked on four at a time: each place among the four counts."""
    monkeypatch.chdir(tmp_path)
    spec = mujoco.MjSpec.from_string("<mujoco/>")
    for i in range(6):
        body = spec.worldbody.add_body(name=f"ball{i}", pos=[float(i), 0.0, -5.0])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0], mass=3.0)
    drag = np.array([75.0, 75.0, 75.0, 0.0, 0.0, 0.0])
    wet = BodyHydrodynamics(volume=0.003, quadratic_damping=drag)
    water.attach(spec, {f"ball{i}": wet for i in range(6)})

    for i in range(6):
        for at, value, words in (
            (6 * i, 60.0, "faster than its drag"),
            (7 * i + 2, 11.0, "above z = 0"),
        ):
            model = hydrodynamics.compile(spec)
            data = mujoco.MjData(model)
            (data.qvel if words.startswith("faster") else data.qpos)[at] = value
            mujoco.mj_forward(model, data)
            assert words in said(), (i, words)
            with pytest.warns(PhysicsWarning):
                hydrodynamics.check_motion(model, data)


# -- slips -----------------------------------------------------------------------------------------


def test_the_projects_own_models_are_above_doubt():
    for name in models.available():
        assert hydrodynamics.doubts(hydrodynamics.compile(models.load(name))) == []


def test_litres_are_told_of():
    with pytest.warns(
        PhysicsWarning,
        match=r"ball: 3 kg in 4.189 m\^3 make 0.716 kg/m\^3, "
        r"outside 30 to 20000",
    ):
        ball(BodyHydrodynamics(volume=4.189, added_mass=np.diag([2e3] * 3 + [10.0] * 3)))


def test_dry_links_of_a_wet_vehicle_are_named():
    with pytest.warns(PhysicsWarning, match=r"movable bodies without water: link, tool$"):
        arm({"hull": WET["hull"]})


@pytest.mark.parametrize("name", ["added_mass", "linear_damping", "quadratic_damping"])
def test_six_vectors_in_another_order_are_told_of(name: str):
    """The published BlueROV2 Heavy as it is printed, and angular first."""
    spec = models.load("bluerov2_heavy")
    hull = water.attached(spec)["hull"]
    numbers = {
        name: np.diag(numbers) if numbers.ndim == 2 else numbers
        for name in ("added_mass", "linear_damping", "quadratic_damping")
        for numbers in (getattr(hull, name),)
    }
    numbers[name] = np.roll(numbers[name], 3)
    swapped = BodyHydrodynamics(
        volume=hull.volume,
        center_of_buoyancy=hull.center_of_buoyancy,
        added_mass=np.diag(numbers["added_mass"]),
        linear_damping=numbers["linear_damping"],
        quadratic_damping=numbers["quadratic_damping"],
    )
    model = hydrodynamics.compile(spec)
    model.body_user[model.body("hull").id, : LAYOUT.size] = water.pack(swapped)
    (doubt,) = hydrodynamics.doubts(model)
    assert doubt.startswith(f"hull: angular over linear {name} is ")
    assert doubt.endswith("six-vectors are (linear; angular)")


def test_a_printed_added_mass_is_made_symmetric():
    """RexROV 2 as published differs by 0.001 in 3660."""
    printed = np.diag([779.79, 1222.0, 3659.9, 534.9, 842.69, 224.32])
    printed[0, 4], printed[4, 0] = -199.453, -199.454
    with pytest.warns(
        PhysicsWarning,
        match=r"\[0, 4\] = -199.453, \[4, 0\] = -199.454; the "
        r"mean of the two is used",
    ):
        body = BodyHydrodynamics(volume=1.84, added_mass=printed)
    assert body.added_mass[0, 4] == body.added_mass[4, 0] == pytest.approx(-199.4535)
    printed[4, 0] += 3.7
    with pytest.raises(ConfigurationError, match="not symmetric"):
        BodyHydrodynamics(volume=1.84, added_mass=printed)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        BodyHydrodynamics(volume=1.0, added_mass=np.eye(6) + 1e-12 * np.eye(6, k=1))
