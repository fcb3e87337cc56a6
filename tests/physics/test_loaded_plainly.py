"""A model that MuJoCo loads from our MJCF by itself is the same vehicle in the same water, to
MJCF's six digits.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.station_keeping import StationKeeping
from uuv.models import hydrodynamics as water
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.interfaces.spatial import exp_so3, quat_wxyz_from_rotation
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.reaction_wrench import wrench
from uuv.sim.water.current import Current

TILTED = exp_so3([0.3, -0.2, 0.5])
REST = np.zeros(6)


@pytest.fixture(params=["from_xml_path", "MjSpec"])
def pair(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Vehicle and arm in water that is not the default, compiled by us; and the same read back by
    MuJoCo alone.
    """
    spec = models.load("uuv_puma")
    water.attach(spec, {}, 998.0)
    ours = hydrodynamics.compile(spec)
    path = tmp_path / "wet.xml"
    path.write_text(spec.to_xml())
    if request.param == "MjSpec":
        return ours, mujoco.MjSpec.from_file(str(path)).compile()
    return ours, mujoco.MjModel.from_xml_path(str(path))


def test_controllers_and_reaction_feel_the_same_water(pair, within):
    hover, holding, reaction = [], [], []
    for model in pair:
        assert hydrodynamics.carries_hydrodynamics(model)
        assert water.water_density(model) == 998.0
        hover.append(StationKeeping(model).static_wrench(TILTED))
        arm = ArmDynamics(model)
        vehicle = Vehicle.of(model)
        data = mujoco.MjData(model)
        q = vehicle.q_ready
        # their weights are those of the dry mass
        model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        holding.append(
            arm.inverse(
                q,
                REST,
                REST,
                R_WB=TILTED,
                nu_B=REST,
                a_B=REST,
                v_current_W=np.zeros(3),
                wrench_tip_G=REST,
            )[0]
        )
        data.qpos[3:7] = quat_wxyz_from_rotation(TILTED)
        data.qpos[vehicle.qpos] = q
        mujoco.mj_forward(model, data)
        reaction.append(wrench(model, data, vehicle.arm_base, frame=vehicle.hull))
    for name, (ours, plain), tolerance in (
        ("hover", hover, 4e-4),  # 4e-5: a small difference of weight and buoyancy
        ("holding", holding, 2e-7),  # 2e-8
        ("reaction", reaction, 5e-5),  # 5e-6
    ):
        assert np.max(np.abs(ours)) > 1.0
        within(name, (plain - ours) / np.max(np.abs(ours)), tolerance)


def test_a_plant_asks_for_its_constants_and_then_feels_gusts(pair):
    ours, plain = pair
    with pytest.raises(
        HydrodynamicsError,
        match=r"contact weights of its dry mass: "
        r".*set_constants",
    ):
        Plant(plain, current=Current(np.zeros(3)))
    hydrodynamics.set_constants(plain)
    assert hydrodynamics.check_installed(plain)
    pushed = []
    for model in (ours, plain):
        gusts = Current(np.zeros(3), gust=0.2, rng=np.random.default_rng(3))
        plant = Plant(model, current=gusts)
        assert np.any(hydrodynamics.current(model, plant.data).acceleration_W)
        plant.observe()
        pushed.append(plant.data.qfrc_passive[:3].copy())
    # six digits of the buoyancy [N]
    np.testing.assert_allclose(pushed[1], pushed[0], rtol=0.0, atol=1e-5 * 3169.0)


def test_its_options_and_waters_are_checked(pair):
    plain = pair[1]
    plain.opt.density = 1000.0
    for refuse in (hydrodynamics.check, hydrodynamics.set_constants):
        with pytest.raises(HydrodynamicsError, match=r"density 1000.0"):
            refuse(plain)
    plain.body_user[1, water.LAYOUT.body_density] = 1025.0
    with pytest.raises(ConfigurationError, match=r"different densities .* hull 1025, "):
        StationKeeping(plain)


def test_a_dry_model_has_no_water():
    dry = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="a"><geom size=".1"/></body></worldbody></mujoco>'
    )
    assert not water.is_wet(dry)
    hydrodynamics.set_constants(dry)
    with pytest.raises(ConfigurationError, match="no hydrodynamics"):
        water.water_density(dry)
