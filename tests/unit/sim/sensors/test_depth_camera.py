"""The depth camera against closed forms and MuJoCo's own rays, and the statistics of its errors."""

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv.clouds.frames import Camera, camera_pose, resting
from uuv.models.objects.targets import barrel
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.sensors.depth_camera import DepthCamera, Optics, StereoNoise, add_noise
from uuv.sim.sensors.visible_world import Visible

SCENE = """
<mujoco>
  <asset>
    <hfield name="seabed" nrow="20" ncol="30" size="3 3 .5 .1"/>
    <mesh name="wedge" vertex="0 0 0  .4 0 0  0 .3 0  0 0 .3"/>
    <material name="glass" rgba="1 1 1 0"/>
  </asset>
  <worldbody>
    <geom type="plane" size="2.2 2.2 .1" pos="0 0 -1"/>
    <geom type="hfield" hfield="seabed" pos="0 0 -1"/>
    <geom type="ellipsoid" size=".1 .2 .3" pos=".5 .9 .2"/>
    <geom type="sphere" size=".2" pos="-.8 .7 .1"/>
    <geom name="picture only" type="box" size=".1 .2 .1" pos="-.9 -.5 0" euler="20 30 40"
      contype="0" conaffinity="0"/>
    <geom type="capsule" size=".1 .2" pos=".9 -.5 0" euler="20 30 40"/>
    <geom type="mesh" mesh="wedge" pos=".1 .2 -.2" euler="10 -30 20"/>
    <geom type="box" size=".3 .3 .01" pos="0 0 .9" material="glass"/>
    <geom type="box" size=".3 .3 .01" pos="0 0 .8" group="3" contype="0" conaffinity="0"/>
    <body name="hull" pos="0 -.3 1.6" euler="10 5 3">
      <freejoint/>
      <geom type="box" size=".2 .2 .1" pos="0 0 .3"/>
      <camera name="eye"/>
      <site name="mount" euler="180 0 0"/>
      <body name="arm" pos=".2 0 -.1">
        <joint axis="0 1 0"/>
        <geom type="capsule" size=".04 .2" pos="0 0 -.4"/>
        <geom type="cylinder" size=".06 .1" pos=".1 0 -.6" euler="0 70 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def scene() -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(SCENE)
    model.hfield_data[:] = np.random.default_rng(0).random(600)
    return model


def exact(spec: mujoco.MjSpec) -> tuple[Array, Array]:
    """Depth without noise, and the rays (H, W, 3) with unit z."""
    image = Camera().frame(spec.compile(), np.random.default_rng(0))
    v, u = np.indices(image.depth.shape).astype(np.float64)
    rays = np.stack(
        [(u - image.K[0, 2]) / image.K[0, 0], (v - image.K[1, 2]) / image.K[1, 1], np.ones_like(u)],
        -1,
    )
    return image.depth, rays


def test_plane_in_closed_form(within):
    spec = mujoco.MjSpec()
    X = pose(exp_so3([np.pi - 0.4, 0.3, 0.0]), [0.0, 0.0, 2.0])
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, X[:3, :3].ravel())
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=X[:3, 3], quat=quat
    )
    depth, rays = exact(spec)
    truth = X[:3, 3] @ X[:3, 2] / (rays @ X[:3, 2])
    truth[(truth < 0.3) | (truth > 10.0)] = np.nan
    assert np.isfinite(depth).mean() > 0.9
    assert np.mean(np.isfinite(depth) != np.isfinite(truth)) < 1e-3
    within("plane [m]", np.nan_to_num(depth - truth), 2e-5)  # 5e-6 at 10 m: single precision


def test_sphere_and_cylinder_in_closed_form(within):
    """Tessellated within 0.2 mm; along the line of sight that is divided by the cosine of
    incidence.
    """
    for kind, size, flat in (
        (mujoco.mjtGeom.mjGEOM_SPHERE, [0.4, 0, 0], np.ones(3)),
        (mujoco.mjtGeom.mjGEOM_CYLINDER, [0.4, 5.0, 0], np.array([0.0, 1.0, 1.0])),
    ):
        spec = mujoco.MjSpec()
        # the cylinder along x
        quat = [1, 0, 0, 0] if flat.all() else [np.sqrt(0.5), 0, np.sqrt(0.5), 0]
        spec.worldbody.add_geom(type=kind, size=size, pos=[0, 0, 1.5], quat=quat)
        depth, rays = exact(spec)
        rays, center = rays * flat, np.array([0.0, 0.0, 1.5])
        a, b, c = (rays**2).sum(-1), -2.0 * rays @ center, center @ center - 0.4**2
        root = b**2 - 4 * a * c
        truth = (-b - np.sqrt(np.maximum(root, 0.0))) / (2 * a)
        well = root > 0.4 * b**2 * (1 - c * 4 * a.min() / b.max() ** 2)  # away from the limb
        assert well.sum() > 5000
        assert np.isfinite(depth[well]).all()
        within(f"{kind} [m]", depth[well] - truth[well], 1e-3)  # 0.4 mm


def test_agrees_with_mujocos_rays(scene: mujoco.MjModel, within):
    """Every kind of geom, static and moving, also one that is only for show, to a millimetre away
    from edges.
    """
    camera = DepthCamera.at_camera(scene, "eye", noise=None)
    data = mujoco.MjData(scene)
    data.qpos[7] = 0.3
    mujoco.mj_kinematics(scene, data)
    mujoco.mj_camlight(scene, data)
    depth, _ = camera.render(data.xpos, data.xmat)
    X_WC = pose(data.cam_xmat[0].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0]), data.cam_xpos[0])
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    geom = np.zeros(1, dtype=np.int32)
    gap, hit = [], set()
    for v in range(2, 480, 17):
        for u in range(2, 640, 17):
            ray = np.array([(u - camera.K[0, 2]) / 554.0, (v - camera.K[1, 2]) / 554.0, 1.0])
            length = float(np.linalg.norm(ray))
            t = (
                mujoco.mj_ray(
                    scene, data, X_WC[:3, 3], X_WC[:3, :3] @ ray / length, groups, 1, -1, geom
                )
                / length
            )
            patch = depth[v - 1 : v + 2, u - 1 : u + 2]
            # nothing there, or an edge: a hair's breadth decides
            if t < 0.0 or np.ptp(patch) > 0.05:
                continue
            hit.add(int(geom[0]))
            gap.append(depth[v, u] - t)
    arm = 10  # 7 is glass, 8 in a group that is not shown; 9 and 11 are out of view
    assert hit == {1, 2, 3, 4, 5, 6, arm}
    assert scene.geom("picture only").id in hit
    within("median [m]", np.median(np.abs(gap)), 1e-5)
    within("worst [m]", gap, 5e-3)  # 1.4 mm, where a line of sight grazes a capsule
    within("99th percentile [m]", np.percentile(np.abs(gap), 99), 1.5e-3)  # 0.8 mm


@pytest.mark.parametrize("p", [(0.0, 0.0, -2999.9), (12345.6, -7654.3, -20.3)])
def test_a_look_is_the_same_anywhere_in_the_world(p: tuple[float, ...], within):
    """Single precision, in which rays are cast, has steps of 0.2 mm at 3 km and 1 mm at 12 km."""

    def look(p_W: Array) -> Array:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.4, 0, 0], pos=p_W + np.array([0.0, 0.1, 1.5])
        )
        model, small = spec.compile(), Optics(width=64, height=48, focal=60.0)
        camera = DepthCamera(model, "world", pose(exp_so3([0.05, 0.03, 0.0]), p_W), optics=small)
        poses = resting(model)
        return camera.render(poses.xpos, poses.xmat)[0]

    here, there = look(np.zeros(3)), look(np.array(p))
    seen = np.isfinite(here)
    assert 200 < seen.sum() == np.isfinite(there).sum()
    within("depth [m]", there[seen] - here[seen], 3e-6)  # 2.4e-7


def test_camera_moves_with_its_hull_and_sees_the_arm_move(scene: mujoco.MjModel):
    camera = DepthCamera.at_site(scene, "mount", noise=None)
    assert isinstance(camera, Sensor)
    state = camera.init(np.random.default_rng(0))
    qpos = scene.qpos0.copy()
    before = camera.step(state, resting(scene, qpos))[1].depth
    lifted = qpos.copy()
    lifted[2] += 0.5
    bent = qpos.copy()
    bent[7] = 1.0
    higher = camera.step(state, resting(scene, lifted))[1].depth
    with_bent_arm = camera.step(state, resting(scene, bent))[1].depth
    assert np.nanmedian(higher) > np.nanmedian(before) + 0.4
    assert np.mean(np.nan_to_num(before) != np.nan_to_num(with_bent_arm)) > 0.02
    blind = DepthCamera.at_site(scene, "mount", noise=None, visible=Visible(exclude=["arm"]))
    clear = blind.step(state, resting(scene, qpos))[1].depth
    assert np.all(np.nan_to_num(clear, nan=11.0) >= np.nan_to_num(before, nan=0.0) - 1e-5)
    assert np.nanmean(clear - before > 0.1) > 0.01


def test_mocap_targets_move(within):
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="buoy", mocap=True, pos=[0, 0, 2])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 0.5])
    model = spec.compile()
    camera = DepthCamera(model, "world", np.eye(4), noise=None)
    for z in (2.0, 3.0):
        xpos = np.array([[0, 0, 0], [0, 0, z]])
        depth, _ = camera.render(xpos, np.tile(np.eye(3).ravel(), (2, 1)))
        within("front face [m]", depth[240, 320] - (z - 0.5), 1e-5)


def flat_wall(z: float, noise: StereoNoise, seed: int) -> Array:
    depth = np.full((480, 640), z, dtype=np.float32)
    result = add_noise(depth, np.ones_like(depth), 554.0, noise, np.random.default_rng(seed))
    return result.astype(np.float64)


@pytest.mark.parametrize("z", [1.0, 2.0])
def test_noise_is_that_of_stereo(z: float, within):
    """sigma_z = z^2 sigma_d / (f b): 3.8 mm at 1 m, 15 mm at 2 m; correlated over 5 px."""
    noise = StereoNoise(flying=0.0, disparity_step=0.0)
    frames = np.stack([flat_wall(z, noise, seed) - z for seed in range(4)])
    expected = z**2 * 0.25 / (554.0 * 0.12)
    within("sigma, relative", frames.std() / expected - 1.0, 0.03)
    within("bias, in sigmas", frames.mean() / expected, 0.05)
    for lag in (2, 5, 10):
        correlation = np.mean(frames[:, :, lag:] * frames[:, :, :-lag]) / frames.var()
        within(f"correlation at {lag} px", correlation - np.exp(-(lag**2) / 25.0), 0.05)
    independent = frames.mean(axis=0)[::20, ::20].std()
    within("frames are independent", independent / (expected / 2.0) - 1.0, 0.1)


def test_disparity_is_quantised(within):
    disparity = 554.0 * 0.12 / flat_wall(1.3, StereoNoise(flying=0.0), 0)
    within("sixteenths of a pixel", disparity * 16.0 - np.rint(disparity * 16.0), 1e-2)
    assert len(np.unique(np.rint(disparity * 16.0))) > 10


@pytest.mark.parametrize("correlation", [0.0, 5.0, 30.0])
def test_sigma_is_that_stated_whatever_the_correlation(correlation: float, within):
    noise = StereoNoise(flying=0.0, disparity_step=0.0, correlation=correlation)
    frames = np.stack(
        [flat_wall(1.0, noise, seed) - 1.0 for seed in range(4 if correlation < 10.0 else 40)]
    )
    within("sigma, relative", frames.std() / (0.25 / (554.0 * 0.12)) - 1.0, 0.05)


def test_turbid_water(within):
    """At contrast C = exp(-c r) the error is 1 / C times as large, and 1 - exp(-(m / C)^2) of the
    pixels are lost.
    """
    clear, turbid = (StereoNoise(flying=0.0, disparity_step=0.0, attenuation=c) for c in (0.0, 1.5))
    depth = np.full((480, 640), 1.2, dtype=np.float32)
    focal = 5540.0  # so narrow that all rays are of one length, to 0.3 %
    seen = []
    for noise in (clear, turbid):
        frames = [
            add_noise(depth, np.ones_like(depth), focal, noise, np.random.default_rng(s))
            for s in range(6)
        ]
        seen.append(focal * 0.12 / np.stack(frames).astype(np.float64))
    contrast = np.exp(-1.5 * 1.2)
    assert np.all(seen[0] > 0.0)
    lost = 1.0 - np.exp(-((0.05 / contrast) ** 2))
    within("lost", (seen[1] == 0.0).mean() - lost, 0.01)
    sigma = (seen[1][seen[1] > 0.0] - focal * 0.12 / 1.2).std()
    within("sigma, relative", sigma * contrast / 0.25 - 1.0, 0.03)
    dark = add_noise(depth * 8, np.ones_like(depth), focal, turbid, np.random.default_rng(0))
    assert np.isinf(dark).mean() > 0.999


def test_edges_fly_and_grazing_surfaces_vanish():
    depth = np.where(np.arange(640) < 320, 1.0, 2.0).astype(np.float32) * np.ones(
        (480, 1), dtype=np.float32
    )
    cosine = np.ones_like(depth)
    cosine[:100] = np.cos(np.deg2rad(76.0))
    only_edges = StereoNoise(disparity_sigma=0.0, disparity_step=0.0)
    result = add_noise(depth, cosine, 554.0, only_edges, np.random.default_rng(0))
    assert np.isinf(result[:100]).all()
    between = (result[100:] > 1.001) & (result[100:] < 1.999)
    assert 0.4 < between[:, 319:321].any(axis=1).mean() < 0.6
    assert not between[:, :319].any()
    assert not between[:, 321:].any()


def test_same_seed_same_frame_and_state_is_explicit():
    spec = mujoco.MjSpec()
    barrel().add_to(spec, camera_pose(np.array([0.2, -0.9, 0.7])))
    model = spec.compile()
    camera, truth = DepthCamera(model, "world", np.eye(4), delay=0.1), resting(model)
    truth.time = 0.25
    first = camera.init(np.random.default_rng(7))
    second, one = camera.step(first, truth)
    _, again = camera.step(first, truth)
    _, next_one = camera.step(second, truth)
    _, other = camera.step(camera.init(np.random.default_rng(8)), truth)
    assert isinstance(one, DepthImage)
    assert one.time == truth.time
    assert np.array_equal(one.depth, again.depth, equal_nan=True)
    assert not np.array_equal(one.depth, next_one.depth, equal_nan=True)
    assert not np.array_equal(one.depth, other.depth, equal_nan=True)
    assert not one.depth.flags.writeable
    seen = one.depth[np.isfinite(one.depth)]
    assert seen.min() >= 0.3
    assert seen.max() <= 10.0


def test_impossible_cameras_are_refused(scene: mujoco.MjModel):
    for make, words in (
        (lambda: DepthCamera(scene, "ship", np.eye(4)), "hull"),
        (lambda: DepthCamera.at_site(scene, "nose"), "mount"),
        (lambda: DepthCamera.at_camera(scene, "nose"), "eye"),
        (lambda: DepthCamera(scene, "hull", np.eye(4), visible=Visible(exclude=["leg"])), "arm"),
        (lambda: DepthCamera(scene, "hull", np.eye(3)), "X_BC"),
        (
            lambda: DepthCamera(scene, "hull", np.diag([1.0, 1.0, -1.0, 1.0])),
            "X_BC: expected a pose",
        ),
        (lambda: Optics(focal=-1.0), "focal"),
        (lambda: Optics(focal=np.inf), "focal"),
        (lambda: Optics(width=untyped(64.5)), "64.5"),
        (lambda: DepthCamera(scene, "hull", np.eye(4), range_limits=(2.0, 1.0)), "range_limits"),
        (lambda: DepthCamera(scene, "hull", np.eye(4), delay=-1.0), "delay"),
        (lambda: StereoNoise(baseline=0.0), "baseline"),
        (lambda: StereoNoise(flying=2.0), "flying"),
        (lambda: StereoNoise(max_incidence=2.0), "max_incidence"),
        (lambda: StereoNoise(disparity_sigma=-1.0), "disparity_sigma"),
        (lambda: StereoNoise(attenuation=np.nan), "attenuation"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            make()
