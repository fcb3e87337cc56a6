"""What the plant reads off MuJoCo's memory, against what MuJoCo's binding says of the same step."""

import mujoco
import numpy as np
import pytest

from uuv.sim.plant.readout import (
    COLLISION,
    CONTACTS,
    FORCE,
    LEAST,
    MOST,
    NORMAL,
    colliding_geoms,
    gears_and_contacts,
    places_of,
)

# A "vehicle" of two balls, one of them the pad; a floor, a wall, and a stone that lies loose. With
# friction in a joint.
WORLD = """
<mujoco>
  <option cone="{cone}"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" condim="{condim}"/>
    <body name="vehicle" pos="0 0 .098"> <freejoint/>
      <geom name="pad" size=".1" condim="{condim}" friction=".8 .01 .001"/>
      <body pos=".25 0 0">
        <joint name="j" axis="0 0 1" frictionloss=".3" armature=".05"/>
          <geom name="arm" size="{arm}"/>
      </body>
    </body>
    <body pos="-.19 0 .12"> <freejoint/> <geom name="stone" size=".1"/> </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("condim", [1, 3, 4, 6])
@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_contacts_and_gears_are_those_of_the_binding(cone, condim, within):
    """The pad between floor and stone, pushed and sliding, step by step; stone on the floor is no
    business of ours.
    """
    model = mujoco.MjModel.from_xml_string(WORLD.format(cone=cone, condim=condim, arm=0.02))
    data = mujoco.MjData(model)
    pad = model.geom("pad").id
    root = np.asarray(model.body_rootid)
    vehicle_geoms = root[model.geom_bodyid] == model.body("vehicle").id
    places = places_of(data, model, pad)
    contacts = np.zeros(CONTACTS)
    tau = np.zeros(1)
    nothing = np.zeros(4)
    met = np.full(3, -1.0)
    data.qvel[:2] = (-0.5, 0.3)
    data.qvel[6] = 2.0
    worst, pushed, slid, rubbed = 0.0, 0.0, 0.0, 0.0
    for _ in range(60):
        mujoco.mj_step(model, data)
        gears_and_contacts(
            (places, np.array([0]), vehicle_geoms, nothing, tau, contacts, met), 0, 1
        )
        normal = 0.0
        force = np.zeros(3)
        part = np.zeros(6)
        for i in range(data.ncon):
            contact = data.contact[i]
            if (
                vehicle_geoms[contact.geom[0]] == vehicle_geoms[contact.geom[1]]
                or contact.efc_address < 0
            ):
                continue
            mujoco.mj_contactForce(model, data, i, part)
            normal += part[0]
            force += (
                (1.0 if contact.geom[1] == pad else -1.0) * contact.frame.reshape(3, 3).T @ part[:3]
            )
        worst = max(
            worst,
            abs(contacts[NORMAL] - normal),
            float(np.abs(contacts[FORCE : FORCE + 3] - force).max()),
        )
        worst = max(worst, abs(tau[0] - data.efc_force[data.ne]))
        pushed = max(pushed, normal)
        slid = max(slid, float(np.hypot(*force[:2])))
        rubbed = max(rubbed, abs(tau[0]))
        assert contacts[COLLISION] == 0.0
        assert met[0] == -1.0
        assert contacts[LEAST] == contacts[MOST] == contacts[NORMAL]
    assert pushed > 10.0
    assert slid > 1.0
    assert rubbed > 0.1
    within("force off the binding's [N]", worst, 1e-10)  # measured 0 to 2e-14


def test_what_touches_beside_the_pad_is_a_collision():
    """The arm's ball reaches the floor, too; before any step there is neither contact nor
    friction.
    """
    model = mujoco.MjModel.from_xml_string(WORLD.format(cone="elliptic", condim=3, arm=0.1))
    data = mujoco.MjData(model)
    vehicle_geoms = np.asarray(model.body_rootid)[model.geom_bodyid] == model.body("vehicle").id
    places = places_of(data, model, model.geom("pad").id)
    contacts = np.ones(CONTACTS)
    tau = np.ones(1)
    met = np.full(3, -1.0)
    for collided in (False, True):
        parts = places, np.array([0]), vehicle_geoms, np.zeros(4), tau, contacts, met
        gears_and_contacts(parts, 0, 1)
        assert bool(contacts[COLLISION]) is collided
        if not collided:
            assert not contacts.any()
            assert tau[0] == 0.0
        data.time = 0.25
        mujoco.mj_forward(model, data)
    assert met.tolist() == [model.geom("arm").id, model.geom("floor").id, 0.25]


TOOLS = """
<mujoco>
  <worldbody>
    <geom name="{p}floor" type="plane" size="3 3 .1"/>
    <body name="{p}hull" pos=".1 .2 .3" euler="10 20 30"> <freejoint/>
      <geom name="{p}shell" size=".1"/>
      <body name="{p}pad" pos=".3 0 .1"> <joint name="{p}pad" type="slide"/>
        <geom name="{p}pad" size=".1"/> {same}
        <body pos=".1 0 0"> <joint name="{p}{joint}" type="slide"/> {other}
          <geom name="{p}tip" size=".02"/> </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("prefix", ["", "second/"])
@pytest.mark.parametrize(
    ("same", "other", "joint", "excused"),
    [
        ([], ["pad_right"], "gripper_right", ["pad_right"]),
        (["pad_right", "pad_bottom"], [], "j", ["pad_right", "pad_bottom"]),
        ([], ["pad_right"], "j", []),  # a part of a user's that is called so
        (["pad_right"], [], "j", []),
        (["pad_bottom"], ["pad_right"], "j", []),
    ],
)
def test_what_else_touches_is_excused_on_a_gripper_or_a_socket_alone(
    prefix: str, same: list[str], other: list[str], joint: str, excused: list[str]
) -> None:
    same_text, other_text = (
        "".join(f'<geom name="{prefix}{name}" size=".05"/>' for name in names)
        for names in (same, other)
    )
    text = TOOLS.format(p=prefix, same=same_text, other=other_text, joint=joint)
    model = mujoco.MjModel.from_xml_string(text)
    mask = colliding_geoms(model, model.body(f"{prefix}hull").id, f"{prefix}pad")
    free = {model.geom(int(i)).name.removeprefix(prefix) for i in np.flatnonzero(~mask)}
    assert free == {"floor", *excused}
