"""What is derived from M + A block by block, against one dense inverse of the matrix that the
callback makes.
"""

import time

import mujoco
import numpy as np
import pytest
from random_trees import random_coefficients, random_spec

from uuv import models
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import LAYOUT, BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.water import wet_inertia

# Four trees: a moving base with two branches, a chain on a fixed base, a free body, and one without
# water. Bodies that are welded to a moving one and to the world, a tendon and a servo across trees,
# and a tendon that is slack.
TREES = """
<mujoco>
  <option timestep="1e-3"/>
  <worldbody>
    <body name="base"> <freejoint/> <geom type="box" size=".3 .2 .1" mass="20"/>
      <body name="left" pos=".3 .2 0"> <joint name="l1" axis="0 1 1"/>
        <geom size=".1" pos=".2 0 0" mass="3"/>
        <body name="finger" pos=".4 0 0"> <joint type="ball"/>
          <geom size=".08" pos=".1 .1 0" mass="1"/> </body>
        <body name="plate" pos=".1 .1 .1"> <geom type="box" size=".1 .1 .01" mass=".5"/> </body>
          </body>
      <body name="right" pos=".3 -.2 0"> <joint name="r1" type="slide" axis="1 0 0"/>
        <geom size=".1" mass="2"/> </body>
    </body>
    <body name="chain_1" pos="2 0 0"> <joint name="c1" axis="0 1 0" armature=".02"/>
      <geom size=".1" mass="2"/>
      <body name="chain_2" pos=".5 0 0"> <joint name="c2" axis="0 0 1"/>
        <geom size=".1" pos=".3 0 0" mass="2"/>
        <body name="chain_3" pos=".5 0 0">
          <joint name="c3" axis="1 0 1"/> <geom size=".1" pos="0 .2 0" mass="1"/> </body>
      </body> </body>
    <body name="stone" pos="4 0 0"> <freejoint/> <geom size=".2" mass="40"/> </body>
    <body name="dry" pos="6 0 0"> <freejoint/> <geom size=".2" mass="5"/> </body>
    <body name="post" pos="8 0 0"> <geom size=".2" mass="5"/> </body>
  </worldbody>
  <tendon>
    <fixed name="across"> <joint joint="l1" coef="2"/> <joint joint="c2" coef="-1"/>
      <joint joint="r1" coef="3"/>
    </fixed>
    <fixed name="slack"> <joint joint="c1" coef="0"/> </fixed>
  </tendon>
  <actuator> <motor tendon="across" gear="3"/> <position joint="c3" kp="20" dampratio=".7"/>
    <position tendon="across" kp="5" dampratio="1"/> </actuator>
</mujoco>
"""
WET = ("base", "left", "finger", "plate", "right", "chain_1", "chain_3", "stone", "post")


def trees(rng: np.random.Generator) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(TREES)
    water.attach(spec, {name: random_coefficients(rng) for name in WET})
    return spec


def stones(count: int) -> mujoco.MjSpec:
    """Wet free bodies in rows, each given its water by a call of its own."""
    spec = mujoco.MjSpec()
    for i in range(count):
        body = spec.worldbody.add_body(name=f"stone_{i}", pos=[i % 20, i // 20, -5])
        body.add_freejoint()
        body.add_geom(size=[0.2, 0, 0], mass=60.0)
        water.attach(spec, {body.name: water.sphere(0.2)})
    return spec


def chain(links: int) -> mujoco.MjSpec:
    """Hinged links, one on the other, each with its water."""
    spec = mujoco.MjSpec()
    parent = spec.worldbody
    for i in range(links):
        parent = parent.add_body(name=f"link_{i}", pos=[0.2 if i else 0.0, 0, 0])
        parent.add_joint(axis=[0, i % 2, 1 - i % 2], armature=0.5)
        parent.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[0.03, 0, 0],
            fromto=[0, 0, 0, 0.2, 0, 0],
            mass=2.0,
        )
    water.attach(
        spec, {f"link_{i}": water.cylinder(0.03, [0, 0, 0], [0.2, 0, 0]) for i in range(links)}
    )
    return spec


def dense_constants(model: mujoco.MjModel) -> dict[str, Array]:
    """The constants by the inverse of the whole M + A, as the callback leaves it at qpos0."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    for row, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    inverse = np.linalg.inv(inertia)

    bodies = np.zeros((model.nbody, 2))
    J = np.zeros((6, model.nv))
    for i in np.flatnonzero(model.body_weldid):
        mujoco.mj_jacBodyCom(model, data, J[:3], J[3:], i)
        mobility = np.diag(J @ inverse @ J.T)
        bodies[i] = mobility[:3].mean(), mobility[3:].mean()
    dofs = np.zeros(model.nv)
    mobility = np.diag(inverse)
    for joint in range(model.njnt):
        first, kind = model.jnt_dofadr[joint], model.jnt_type[joint]
        for size in {0: (3, 3), 1: (3,)}.get(int(kind), (1,)):  # free, ball
            dofs[first : first + size] = mobility[first : first + size].mean()
            first += size
    tendons = np.zeros((model.ntendon, model.nv))
    for row, start, count in zip(tendons, model.ten_J_rowadr, model.ten_J_rownnz, strict=True):
        row[model.ten_J_colind[start : start + count]] = data.ten_J[start : start + count]
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return {
        "body_invweight0": bodies,
        "dof_invweight0": dofs,
        "dof_M0": np.diag(inertia),
        "tendon_invweight0": np.einsum("ij,jk,ik->i", tendons, inverse, tendons),
        "actuator_acc0": np.linalg.norm(moments @ inverse, axis=1),
    }


WAYS = {"whole": (64, 320), "trees": (11, 320), "inverse of trees": (1, 320), "sparse": (1, 0)}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "scene", [trees, lambda rng: random_spec(rng)[0], lambda _: stones(5), lambda _: chain(9)]
)
def test_constants_are_those_of_the_dense_inverse(scene, way: str, rng, monkeypatch, within):
    small, inverse = WAYS[way]
    monkeypatch.setattr(wet_inertia, "LARGEST_SMALL", small)
    monkeypatch.setattr(wet_inertia, "LARGEST_INVERSE", inverse)
    model = hydrodynamics.compile(scene(rng))
    for name, reference in dense_constants(model).items():
        constants = getattr(model, name)
        moved = reference != 0.0
        assert np.all(moved == (constants != 0.0))
        if moved.any():
            within(name, constants[moved] / reference[moved] - 1.0, 4e-14)  # measured 3e-15
    within("meaninertia", model.stat.meaninertia / model.dof_M0.mean() - 1.0, 1e-14)


def test_a_vehicle_beside_a_loose_object_has_the_weights_of_the_whole_inverse_to_the_bit():
    """The last digits of trajectories depend on them; trees that are inverted one by one round
    otherwise.
    """
    spec = models.load("uuv_puma")
    loose = spec.worldbody.add_body(name="loose", pos=[2, 0, 0])
    loose.add_freejoint()
    loose.add_geom(size=[0.2, 0, 0], mass=34.0)
    water.attach(spec, {"loose": water.sphere(0.2)})
    model = hydrodynamics.compile(spec)

    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    inertia = np.zeros((model.nv, model.nv))
    for row, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    inverse = np.linalg.inv(inertia + hydrodynamics.added_inertia(model, data))
    J = np.zeros((6, model.nv))
    for i in np.flatnonzero(model.body_weldid):
        mujoco.mj_jacBodyCom(model, data, J[:3], J[3:], i)
        mobility = np.einsum("ij,jk,ik->i", J, inverse, J)
        assert [*model.body_invweight0[i]] == [mobility[:3].mean(), mobility[3:].mean()]
    assert model.dof_invweight0[-1] == np.diag(inverse)[-3:].mean()


def test_servos_across_trees_are_damped_by_the_wet_inertia(rng, within):
    model = hydrodynamics.compile(trees(rng))
    inverse_of_reflected = dense_constants(model)["tendon_invweight0"][model.tendon("across").id]
    kp = model.actuator_gainprm[2, 0]
    within(
        "damping",
        -model.actuator_biasprm[2, 2] / (2.0 * np.sqrt(kp / inverse_of_reflected)) - 1.0,
        1e-14,
    )


@pytest.mark.parametrize("scene", [trees, lambda _: chain(70)])
def test_rate_of_the_drag_by_lanczos_is_that_by_lapack(scene, rng, monkeypatch, within):
    spec = scene(rng)
    rates = []
    for small in (1000, 1):
        monkeypatch.setattr(wet_inertia, "LARGEST_SMALL", small)
        model = hydrodynamics.compile(spec)
        rates.append(model.body_user[0, LAYOUT.drag_rate :][:2].copy())
    assert rates[0][1] > 0.0
    within("rates", rates[1] - rates[0], 1e-6 * rates[0].max())


@pytest.mark.parametrize("small", [64, 1])
def test_an_indefinite_inertia_is_refused_however_it_is_factored(small: int, rng, monkeypatch):
    monkeypatch.setattr(wet_inertia, "LARGEST_SMALL", small)
    model = hydrodynamics.compile(trees(rng))
    model.dof_armature[model.joint("c2").dofadr] = -1e3
    with pytest.raises(
        HydrodynamicsError,
        match=r"not positive definite at qpos0 \(its diagonal "
        r"runs from -",
    ):
        hydrodynamics.set_constants(model)


def test_many_bodies_cost_what_each_of_them_costs():
    """200 stones took 20 s to attach and did not compile within 120 s when all was dense."""
    start = time.process_time()
    model = hydrodynamics.compile(stones(200))
    assert time.process_time() - start < 4.0  # [s] measured 0.4
    assert np.all(model.dof_invweight0 == np.tile(model.dof_invweight0[:6], 200))


def test_a_fixed_body_alone_has_water_and_no_weight():
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="post"><geom size=".1"/></body></worldbody></mujoco>'
    )
    water.attach(spec, {"post": BodyHydrodynamics(volume=1.0)})
    model = hydrodynamics.compile(spec)
    assert hydrodynamics.check_installed(model)
    assert not model.body_invweight0.any()
