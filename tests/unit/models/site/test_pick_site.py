"""The site of a collection: mass and water of a loose object, and how it comes to rest."""

import numpy as np
import pytest

from uuv.models.meshes.closed_shells import sphere
from uuv.models.objects.rock import stone
from uuv.models.objects.target_model import TargetModel
from uuv.models.site.pick_site import RIM, LooseObject, at_rest, basket_half, pick_site
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

R = 0.04  # [m]


def test_a_ball_has_the_mass_volume_and_weight_of_its_shape() -> None:
    unit, triangles = sphere(4)
    target = TargetModel(name="ball", vertices=R * unit, triangles=triangles)
    loose = LooseObject.of(target, density=2600.0, mass=None)
    assert loose.volume == pytest.approx(4.0 / 3.0 * np.pi * R**3, rel=0.01)
    assert loose.mass == pytest.approx(2600.0 * loose.volume)
    assert loose.weight(1025.0, 9.81) == pytest.approx(9.81 * 1575.0 * loose.volume)
    assert LooseObject.of(target, density=2600.0, mass=0.1).weight(1025.0, 9.81) < 0.0  # it floats


def test_an_open_mesh_displaces_what_its_hull_does() -> None:
    unit, triangles = sphere(3)
    above = np.all(unit[triangles][:, :, 2] > -0.2, axis=1)
    target = TargetModel(name="bowl", vertices=R * unit, triangles=triangles[above])
    turned = TargetModel(name="bowl", vertices=R * unit, triangles=triangles[above][:, ::-1])
    volumes = [LooseObject.of(mesh, density=1e3, mass=None).volume for mesh in (target, turned)]
    assert all(volume > 0.3 * 4.0 / 3.0 * np.pi * R**3 for volume in volumes)


def test_a_stone_lies_as_it_comes_to_rest_and_stays_in_a_current() -> None:
    target = stone(2)
    drawn = pose(exp_so3([0.0, 0.0, 0.5]), [0.2, -0.4, -1.3])
    seabed = -1.5
    X_WT = at_rest(target, drawn, seabed)
    assert transform_points(X_WT, target.vertices)[:, 2].min() == pytest.approx(seabed, abs=1e-3)

    # In the scene of the work, with its stiff contacts, it stays there.
    loose = LooseObject.of(target, density=2600.0, mass=None)
    half = basket_half(target)
    basket = (np.array([0.7, -0.4, seabed]), half)
    spec = vehicle_spec("uuv_puma", tool="gripper")
    scene = pick_site(spec, target, X_WT, loose, seabed=seabed, basket=basket)
    model = hydrodynamics.compile(scene)
    plant = Plant(model, current=Current([0.3, 0.1, 0.0]), X_WB=pose(p=[0.0, 0.0, 3.0]))
    body = model.body("target").id
    plant.observe()
    begin = plant.data.xpos[body].copy()

    still = Command(
        time=0.0,
        joint_torque=np.zeros(len(plant.vehicle.q_home)),
        thrusters=np.zeros(len(plant.vehicle.thruster_names)),
        scan=False,
    )
    for _ in range(400):
        plant.step(still)
        plant.observe()
    assert np.linalg.norm(plant.data.xpos[body] - begin) < 3e-3
    assert model.geom("basket_wall_0").size[2] == pytest.approx(0.5 * RIM)
