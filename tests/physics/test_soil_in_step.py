"""Soil acts inside MuJoCo's step: on a slide against its law, on an arm by virtual work, and in
files and batches.
"""

import mujoco
import mujoco.batch
import numpy as np
import pytest

from uuv.models.naming import TIP_SITE
from uuv.models.site import soil_bed
from uuv.models.site.seabed import Seabed
from uuv.models.site.soil import core_tube, depth_for, mud, sand
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.plant.reaction_wrench import ReactionWrench, wrench
from uuv.sim.plant.soil_contact import SoilContact, feel_soil

TUBE = core_tube(0.018, 0.002)
GROUND = Seabed(
    kind="flat",
    heights=np.zeros((21, 21)),
    half=1.0,
    center_W=np.array([0.2, -0.1, -0.5]),
    rocks=np.zeros((0, 3)),
)

SLIDE = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody> <body name="tube" pos="0.1 0 -0.49"> <joint type="slide" axis="0 0 1"/>
    <geom size=".02" mass="8" contype="0" conaffinity="0"/> <site name="tip" xyaxes="1 0 0 0 -1 0"/>
  </body> </worldbody>
</mujoco>
"""

ARM = """
<mujoco>
  <worldbody> <body name="hull" pos="0 0 0.12" euler="5 -8 20"> <freejoint/>
    <geom size=".1" mass="5"/>
    <body name="a"> <joint name="a" axis="0 1 0.2"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .4 0 0"/>
      <body name="b" pos=".4 0 0"> <joint name="b" axis="0 1 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.7"/>
        <site name="tip" pos="0 0 -.7" xyaxes="1 0 0 0 -1 0"/> </body> </body>
  </body> </worldbody>
</mujoco>
"""


def compiled(xml: str, soil=None) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(xml)
    soil_bed.attach(spec, GROUND, sand() if soil is None else soil, TUBE)
    hydrodynamics.install()
    return spec.compile()


@pytest.mark.check("soil: a tube at rest under its weight", "its law of resistance with depth")
def test_a_tube_sinks_until_the_soil_bears_it(within):
    model = compiled(SLIDE, mud())
    data = mujoco.MjData(model)
    for _ in range(20_000):
        data.qvel *= 0.99  # else it would swing on the quake
        mujoco.mj_step(model, data)
    depth = -0.01 - float(data.qpos[0])  # it begins 1 cm above the ground
    weight = 8.0 * 9.81
    within("weight held [N]", data.qfrc_passive[0] - weight, 1e-6)
    # measured 2.4e-4; the quake is 1e-3
    within("depth [m]", depth - depth_for(mud(), TUBE, weight), 5e-4)


def test_joint_forces_are_those_of_virtual_work(within, rng):
    """J^T f for the force of the kernel, at random postures with the tip in the soil."""
    model = compiled(ARM)
    data = mujoco.MjData(model)
    contact = SoilContact.of(model, data)
    felt = 0
    for _ in range(50):
        mujoco.mj_resetData(model, data)
        data.qpos[:3] += rng.uniform(-0.05, 0.05, 3)
        data.qpos[7:] = rng.uniform(-0.3, 0.3, 2)
        mujoco.mj_kinematics(model, data)
        site = model.site(TIP_SITE).id
        data.act[:] = [*(data.site_xpos[site] + rng.uniform(-2e-3, 2e-3, 3)), 1.0]
        mujoco.mj_forward(model, data)

        feel_soil(contact)
        J = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, J, None, site)
        within("generalised force", data.qfrc_passive - J.T @ contact.force[1:], 1e-12)
        felt += bool(np.any(contact.force))
    assert felt > 20


def test_files_and_batches_dig_alike(tmp_path):
    model = compiled(SLIDE)
    mujoco.mj_saveModel(model, str(tmp_path / "soil.mjb"))
    ends = []
    for variant in (model, mujoco.MjModel.from_binary_path(str(tmp_path / "soil.mjb"))):
        data = mujoco.MjData(variant)
        mujoco.mj_step(variant, data, 300)
        ends.append([*data.qpos, *data.act])
    batch = mujoco.batch.Batch(model, nsim=2, nthread=2)
    batch.step(nstep=300)
    ends += [[*qpos, *act] for qpos, act in zip(batch.bind("qpos"), batch.bind("act"), strict=True)]
    assert ends[0][-1] == pytest.approx(1.0, abs=1e-12)  # in the soil
    assert all(end == ends[0] for end in ends)


def test_soil_without_a_tool_or_twice_is_refused():
    spec = mujoco.MjSpec.from_string("<mujoco/>")
    with pytest.raises(ConfigurationError, match=r"no site 'pad_face' or 'tip'"):
        soil_bed.attach(spec, GROUND, sand(), TUBE)
    spec = mujoco.MjSpec.from_string(SLIDE)
    soil_bed.attach(spec, GROUND, sand(), TUBE)
    with pytest.raises(ConfigurationError, match="'soil' already"):
        soil_bed.attach(spec, GROUND, sand(), TUBE)


def test_the_reaction_of_the_arm_holds_the_soil(within, rng):
    """As with the same force in `xfrc_applied` on a model without soil, before and after a step."""
    model = compiled(ARM)
    plain = mujoco.MjModel.from_xml_string(ARM)
    data, other = mujoco.MjData(model), mujoco.MjData(plain)
    site = model.site(TIP_SITE).id
    body = model.body("b").id
    reaction = ReactionWrench(model, "a", frame="hull")
    contact = SoilContact.of(model, data)
    felt = 0
    for _ in range(20):
        mujoco.mj_resetData(model, data)
        data.qpos[7:] = rng.uniform(-0.3, 0.3, 2)
        data.qvel[:] = 0.2 * rng.normal(size=model.nv)
        mujoco.mj_kinematics(model, data)
        data.act[:] = [*(data.site_xpos[site] + rng.uniform(-2e-3, 2e-3, 3)), 1.0]
        mujoco.mj_forward(model, data)
        feel_soil(contact)
        f_W = contact.force[1:].copy()
        felt += bool(np.any(f_W))

        other.qpos[:], other.qvel[:] = data.qpos, data.qvel
        other.xfrc_applied[body] = [*f_W, *np.cross(data.site_xpos[site] - data.xipos[body], f_W)]
        mujoco.mj_forward(plain, other)
        expected = wrench(plain, other, "a", frame="hull")
        within("before the step", reaction.wrench(data) - expected, 1e-10)

        before = data.qvel.copy()
        mujoco.mj_step(model, data)
        within("after the step", reaction.wrench(data, before, f_W) - expected, 1e-10)
        with pytest.raises(HydrodynamicsError, match="give the force of the soil as soil_W"):
            reaction.wrench(data, before)
    assert felt > 10
