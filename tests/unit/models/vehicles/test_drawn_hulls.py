"""What is drawn of the vehicles: within their published size, the same on both sides, in colours
that exist.
"""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models.vehicles import bluerov2_heavy
from uuv.sim.interfaces.spatial import Array


def extents(model: mujoco.MjModel, geom: int) -> Array:
    """Half sizes (3,) [m] of a geom along its body's axes."""
    R = np.empty(9)
    size = model.geom_size[geom]
    mujoco.mju_quat2Mat(R, model.geom_quat[geom])
    R = R.reshape(3, 3)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        return np.abs(R) @ size
    assert model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
    return np.abs(R[:, 2]) * size[1] + size[0]


@pytest.mark.parametrize("name", ["bluerov2_heavy_benzon2022", "bluerov2_heavy_wu2018"])
def test_a_bluerov_is_drawn_within_its_size_and_alike_on_both_sides(name: str) -> None:
    model = models.load(name).compile()
    hull = model.body("hull").id
    half = 0.5 * np.array([bluerov2_heavy.LENGTH, bluerov2_heavy.WIDTH, bluerov2_heavy.HEIGHT])
    drawn = [i for i in range(model.ngeom) if model.geom_bodyid[i] == hull]
    boxes = {model.geom(i).name: (model.geom_pos[i], extents(model, i)) for i in drawn}
    assert {"frame", "foam_port", "foam_starboard", "housing"} <= set(boxes)
    for p, e in boxes.values():
        assert np.all(np.abs(p) + e <= half + 1e-9)
    np.testing.assert_allclose(boxes["frame"][1], half)
    # The housing lies along the vehicle, the foam above it on either side.
    np.testing.assert_allclose(boxes["housing"][1][1], boxes["housing"][1][2])
    assert boxes["housing"][1][0] > 2.0 * boxes["housing"][1][1]
    mirror = np.diag([1.0, -1.0, 1.0])
    np.testing.assert_allclose(boxes["foam_port"][0], mirror @ boxes["foam_starboard"][0])
    assert boxes["foam_port"][0][1] - boxes["foam_port"][1][1] > boxes["housing"][1][1]
    assert boxes["foam_port"][0][2] - boxes["foam_port"][1][2] > 0.0
    thrusters = model.actuator_gear[: model.nu, :3]
    places = model.site_pos[model.actuator_trnid[: model.nu, 0]]
    assert {tuple(p) for p in np.round(places @ mirror, 9)} == {
        tuple(p) for p in np.round(places, 9)
    }
    np.testing.assert_allclose(np.linalg.norm(thrusters, axis=1), 1.0)


@pytest.mark.parametrize(
    "name", ["uuv_puma", "bluerov2_heavy_alpha5", "phoenix_smart3s", "reach_alpha_5"]
)
def test_colours_are_colours_and_quaternions_are_units(name: str) -> None:
    spec = models.load(name)
    drawn = [*spec.geoms, *spec.sites, *spec.materials]
    assert len(drawn) > 4
    for element in drawn:
        assert np.all((np.array(element.rgba) >= 0.0) & (np.array(element.rgba) <= 1.0)), (
            element.name
        )
    for element in (*spec.geoms, *spec.sites, *spec.bodies):
        assert np.linalg.norm(element.quat) == pytest.approx(1.0, abs=1e-6), element.name


@pytest.mark.parametrize("name", ["bluerov2_heavy_benzon2022", "bluerov2_heavy_alpha5"])
def test_a_camera_looks_ahead_with_the_right_way_up(name: str) -> None:
    """OpenCV axes: z ahead, x to starboard, y down."""
    model = models.load(name).compile()
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.site("camera").quat)
    np.testing.assert_allclose(R.reshape(3, 3), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    assert model.site("camera").pos[1] == 0.0


@pytest.mark.parametrize("name", ["uuv_puma", "bluerov2_heavy_alpha5", "phoenix_smart3s"])
def test_keyframes_are_within_the_limits_and_upright(name: str) -> None:
    model = models.load(name).compile()
    limited = np.flatnonzero(model.jnt_limited)
    assert model.nkey >= 2
    for key in model.key_qpos:
        q = key[model.jnt_qposadr[limited]]
        assert np.all((q >= model.jnt_range[limited, 0]) & (q <= model.jnt_range[limited, 1]))
        up = np.array([0.0, 0.0, 1.0])
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, key[3:7])
        np.testing.assert_allclose(R.reshape(3, 3) @ up, up, atol=1e-9)
