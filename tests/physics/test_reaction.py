"""The wrench of a subtree on its parent: closed form, momentum of what is left, nothing on a free
body.
"""

import mujoco
import numpy as np
import pytest

from tests.physics.random_trees import random_spec, semidefinite, set_in_motion
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.interfaces.spatial import Array, exp_so3
from uuv.sim.plant.reaction_wrench import ReactionWrench, wrench

LINK = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1" euler="10 0 0">
      <body name="link" pos=".1 0 0" euler="-10 0 0"> {joint} <site name="s"/>
        <inertial pos="0 0 -.2" mass="2" diaginertia=".1 .1 .1"/> </body>
    </body>
  </worldbody>
  <sensor> <force site="s"/> </sensor>
</mujoco>
"""


@pytest.mark.check("reaction of a link of 20 N that displaces 15 N", "5 N")
@pytest.mark.parametrize(
    "joint",
    ["", '<joint axis="0 1 0"/>', '<joint type="slide" axis="1 0 0"/>', '<joint type="ball"/>'],
)
def test_link_of_20_newtons_that_displaces_15(joint, within):
    """It hangs at rest and pulls with 5 N; MuJoCo's force sensor, which does not see the water,
    says 20 N.
    """
    spec = mujoco.MjSpec.from_string(LINK.format(joint=joint))
    spec.option.gravity = [0.0, 0.0, -10.0]
    body = BodyHydrodynamics(
        volume=0.0015,
        center_of_buoyancy=np.array([0.0, 0.0, -0.1]),
        added_mass=semidefinite(np.random.default_rng(1), 1),
    )
    water.attach(spec, {"link": body}, 1000.0)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    # measured 1e-15
    within("wrench [N, N m]", wrench(model, data, "link") - [0, 0, -5, 0, 0, 0], 1e-14)
    R = data.body("base").xmat.reshape(3, 3)
    force = R.T @ [0.0, 0.0, -5.0]
    expected = np.concatenate([force, np.cross([0.1, 0.0, 0.0], force)])
    within(
        "wrench at the base [N, N m]", wrench(model, data, "link", frame="base") - expected, 1e-14
    )
    assert abs(data.sensordata[2]) == pytest.approx(20.0)


def touching(rng: np.random.Generator) -> mujoco.MjSpec:
    """A random tree whose bodies collide with each other and with rocks; two of them are tied
    together.
    """
    spec, _ = random_spec(rng)
    for body in spec.bodies[1:]:
        body.add_geom(size=[rng.uniform(0.1, 0.3), 0, 0], condim=int(rng.choice([1, 3, 4, 6])))
    for _ in range(6):
        spec.worldbody.add_geom(size=[0.4, 0, 0], pos=0.8 * rng.normal(size=3))
    first, second = rng.choice(np.arange(1, len(spec.bodies)), 2, replace=False)
    tie = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY)
    tie.name1, tie.name2 = spec.bodies[first].name, spec.bodies[second].name
    tie.data[:3] = 0.1 * rng.normal(size=3)
    spec.option.cone = int(rng.integers(0, 2))
    spec.option.tolerance = 0.0
    spec.option.iterations = 200
    return spec


def outer_forces(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """(nbody, 6) of contacts and ties, at the centres of mass, world axes: force by force."""
    total = np.zeros((model.nbody, 6))

    def push(body: int, f: Array, t: Array, p: Array) -> None:
        total[body, :3] += f
        total[body, 3:] += t + np.cross(p - data.xipos[body], f)

    for i in range(data.ncon):
        local = np.zeros(6)
        frame = data.contact.frame[i].reshape(3, 3)
        mujoco.mj_contactForce(model, data, i, local)
        for geom, sign in zip(data.contact.geom[i], (-1.0, 1.0), strict=True):
            body = int(model.geom_bodyid[geom])
            push(body, sign * frame.T @ local[:3], sign * frame.T @ local[3:], data.contact.pos[i])
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    if len(rows):
        f = data.efc_force[rows]
        for sign, body, anchor in (
            (1.0, model.eq_obj1id[0], model.eq_data[0, :3]),
            (-1.0, model.eq_obj2id[0], model.eq_data[0, 3:6]),
        ):
            push(
                int(body),
                sign * f,
                np.zeros(3),
                data.xpos[body] + data.xmat[body].reshape(3, 3) @ anchor,
            )
    return total


@pytest.mark.check("reaction of random subtrees in contact", "the rest moves alike under it")
def test_what_is_left_moves_alike_under_the_wrench_alone(rng, within):
    """A subtree is cut off a random tree in motion and contact, and only its wrench put on its
    parent.
    """
    worst = 0.0
    contacts = 0
    ties = 0
    cuts = 0
    kinds = set[str]()
    while cuts < 20 or contacts < 20 or ties < 5 or len(kinds) < 3:
        spec = touching(rng)
        model = hydrodynamics.compile(spec)
        data = mujoco.MjData(model)
        set_in_motion(model, data, rng)
        data.xfrc_applied = 5.0 * rng.normal(size=(model.nbody, 6))
        mujoco.mj_forward(model, data)
        hung = [i for i in range(1, model.nbody) if model.body_treeid[model.body_parentid[i]] >= 0]
        if not hung:
            continue
        body = int(rng.choice(hung))
        parent = int(model.body_parentid[body])
        f_B = wrench(model, data, body, frame=parent)
        left = [i for i in range(1, model.nbody) if not hangs_from(model, i, body)]
        dofs = [j for j in range(model.nv) if model.dof_bodyid[j] in left]

        applied = data.xfrc_applied + outer_forces(model, data)
        R = data.xmat[parent].reshape(3, 3)
        f_W = R @ f_B[:3]
        lever = data.xpos[parent] - data.xipos[parent]
        applied[parent] += np.concatenate([f_W, R @ f_B[3:] + np.cross(lever, f_W)])
        contacts = contacts + data.ncon
        ties = ties + bool(data.ne)
        kinds.add(
            str(model.jnt_type[model.body_jntadr[body]]) if model.body_jntnum[body] else "weld"
        )

        names = [model.body(i).name for i in left]
        qacc = data.qacc[dofs]
        qpos = np.concatenate(
            [np.array(data.joint(j).qpos) for j in range(model.njnt) if model.jnt_bodyid[j] in left]
        )
        qvel, qfrc = data.qvel[dofs], data.qfrc_applied[dofs]
        spec.delete(spec.equalities[0])
        spec.delete(spec.body(model.body(body).name))
        spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
        rest = hydrodynamics.compile(spec)
        alone = mujoco.MjData(rest)
        alone.qpos, alone.qvel, alone.qfrc_applied = qpos, qvel, qfrc
        for i, name in zip(left, names, strict=True):
            alone.body(name).xfrc_applied = applied[i]
        mujoco.mj_forward(rest, alone)
        # as a force: what a nearly singular tree makes of rounding does not count
        left_over = np.zeros(rest.nv)
        mujoco.mj_mulM(rest, alone, left_over, alone.qacc - qacc)
        worst = max(worst, float(np.max(np.abs(left_over)) / np.max(np.abs(applied))))
        cuts += 1
    within("force left over, relative", worst, 3e-13)  # measured up to 2e-14 over 40 seeds


def hangs_from(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    while body > ancestor:
        body = int(model.body_parentid[body])
    return body == ancestor


FREE = """
<mujoco>
  <option tolerance="0" timestep="1e-3"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body name="hull" pos="0 0 .1" gravcomp=".4"> <freejoint/>
      <geom type="box" size=".5 .3 .2" mass="60"/>
      <site name="port" pos="-.4 .2 0" euler="0 80 10"/>
      <body name="arm" pos=".4 0 0"> <joint name="a" axis="0 1 0" armature=".1" damping="1"/>
        <geom type="capsule" size=".04 .2" pos="0 0 -.25" mass="6"/>
          <site name="jet" pos="0 0 -.4"/> </body>
    </body>
  </worldbody>
  <actuator> <motor site="port" gear="3 1 0 0 .5 0"/> <motor site="jet" gear="0 2 0 0 0 1"/>
    <motor joint="a"/>
  </actuator>
</mujoco>
"""


def free_vehicle(rng: np.random.Generator) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """On the floor, under way, with thrusters on sites, part of its weight held by `gravcomp`."""
    spec = mujoco.MjSpec.from_string(FREE)
    water.attach(
        spec,
        {
            "hull": water.box([1.0, 0.6, 0.4]),
            "arm": water.cylinder(0.04, np.zeros(3), np.array([0, 0, -0.5])),
        },
    )
    water.set_current(spec, rng.normal(size=3), rng.normal(size=3), 0.3 * rng.normal(size=3))
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    set_in_motion(model, data, rng)
    data.qpos[:3] = [0.0, 0.0, 0.1]
    data.ctrl = 10.0 * rng.normal(size=3)
    data.xfrc_applied[2] = 5.0 * rng.normal(size=6)
    mujoco.mj_forward(model, data)
    assert data.ncon > 0
    return model, data


@pytest.mark.check("reaction of a free vehicle, in contact, thrusters on", "nothing")
def test_free_vehicle_puts_nothing_on_the_world(rng, within):
    """But for the generalised forces on its free joint, which count as a joint's; in contact,
    thrusters at work.
    """
    model, data = free_vehicle(rng)
    R = data.body("hull").xmat.reshape(3, 3)
    expected = -np.concatenate([R.T @ data.qfrc_applied[:3], data.qfrc_applied[3:6]])
    residual = wrench(model, data, "hull") - expected
    # measured 2e-15
    within("over the contact forces", residual / np.max(np.abs(data.qfrc_constraint)), 2e-14)


def test_after_a_step_it_is_the_wrench_of_that_step(rng):
    model, data = free_vehicle(rng)
    arm = ReactionWrench(model, "arm", frame="hull")
    before = arm.wrench(data)
    qvel = data.qvel.copy()
    mujoco.mj_step(model, data)
    ahead = data.qvel.copy()
    with pytest.raises(HydrodynamicsError, match="call mj_forward first"):
        arm.wrench(data)
    assert np.array_equal(arm.wrench(data, qvel), before)
    assert np.array_equal(data.qvel, ahead)
    hydrodynamics.uninstall()
    with pytest.raises(HydrodynamicsError, match="the hydrodynamics were not included"):
        arm.wrench(data, qvel)


def test_frame_is_only_another_view(rng, within):
    model, data = free_vehicle(rng)
    here = wrench(model, data, "arm")
    turned_view = wrench(model, data, "arm", frame=1)
    R = exp_so3([0.0, data.joint("a").qpos[0], 0.0])
    force = R @ here[:3]
    moved = np.concatenate([force, R @ here[3:] + np.cross([0.4, 0.0, 0.0], force)])
    within(
        "relative wrench", (turned_view - moved) / np.linalg.norm(moved), 5e-15
    )  # measured 5e-16


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (
            '<tendon><spatial><site site="port"/><site site="jet"/></spatial></tendon>',
            "spatial tendons",
        ),
        ('<actuator><motor site="port" refsite="jet" gear="1 0 0 0 0 0"/></actuator>', "refsite"),
        ('<actuator><adhesion body="arm" ctrlrange="0 1"/></actuator>', "transmission body"),
    ],
)
def test_forces_that_are_not_known_are_refused_by_name(extra, says):
    model = mujoco.MjModel.from_xml_string(FREE.replace("</mujoco>", extra + "</mujoco>"))
    with pytest.raises(HydrodynamicsError, match=says):
        ReactionWrench(model, "arm")


@pytest.mark.parametrize(
    ("body", "says"),
    [("leg", "no such body: leg; the model has hull, arm"), (7, "7"), (0, "world")],
)
def test_bodies_that_are_not_there(body, says):
    with pytest.raises(ConfigurationError, match=says):
        ReactionWrench(mujoco.MjModel.from_xml_string(FREE), body)
