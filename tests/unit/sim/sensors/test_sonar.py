"""The 3D sonar and the world that its rays see, against closed forms; the statistics of its
errors.
"""

from dataclasses import replace
from typing import Literal

import mujoco
import numpy as np
import pytest

from depth_scenes import standing
from untyped import untyped
from uuv.clouds.frames import camera_pose, resting
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects.targets import TargetModel, barrel
from uuv.perception.clouds.sonar_cloud import sonar_model, without_isolated_echoes
from uuv.perception.finding.target_finder import KnownObjectFinder
from uuv.perception.registration.identification import identify
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import SonarScan
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, inverse, pose, rotation_from_z, transform_points
from uuv.sim.sensors.sonar import Sonar, SonarBeams, SonarNoise, SonarState
from uuv.sim.sensors.tessellation import tessellate
from uuv.sim.sensors.visible_world import Rays, Visible, VisibleWorld

DOWN = np.diag([1.0, -1.0, -1.0])  # S looking down in W
PENCIL = SonarBeams(rows=1, columns=1, width=0.0)

ONE_OF_EACH = """
<mujoco>
  <asset>
    <hfield name="slope" nrow="2" ncol="2" size=".4 .4 .5 .1"/>
    <mesh name="wedge" vertex="-.3 -.3 0  .3 -.3 0  0 .3 0  0 0 .6"/>
  </asset>
  <worldbody>
    <geom type="plane" size="20 20 1" pos="0 0 -1"/>
    <geom type="sphere" size=".3" pos="0 0 0"/>
    <geom type="capsule" size=".1 .3" pos="2 0 0" euler="0 90 0"/>
    <geom type="ellipsoid" size=".1 .2 .35" pos="4 0 0"/>
    <geom type="cylinder" size=".2 .3" pos="6 0 0" euler="0 90 0"/>
    <geom type="box" size=".1 .2 .15" pos="8 0 0" contype="0" conaffinity="0"/>
    <geom type="mesh" mesh="wedge" pos="10 0 0"/>
    <geom type="hfield" hfield="slope" pos="12 0 0"/>
    <geom type="box" size=".1 .2 .15" pos="14 0 0" contype="0" conaffinity="0" group="2"/>
    <geom type="box" size=".1 .2 .15" pos="16 0 0" rgba="1 0 0 0"/>
    <body pos="18 0 0"><freejoint/><geom type="sphere" size=".25" contype="0" conaffinity="0"/>
      </body>
  </worldbody>
</mujoco>
"""


def world(xml: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def wall(normal: Array, z: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A plane through (0, 0, z) [m] of a sonar at the origin of W, whose axes are W's."""
    spec = mujoco.MjSpec()
    quat = np.empty(4)
    mujoco.mju_quatZ2Vec(quat, normal)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, z], quat=quat
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def test_every_kind_of_geom_at_its_distance(within):
    """Straight down on each: also on what is only for show, and through what is transparent."""
    model, data = world(ONE_OF_EACH)
    model.hfield_data[:] = [0.0, 0.0, 1.0, 1.0]
    sonar = Sonar(model, "world", np.eye(4), beams=PENCIL, noise=None)
    tops = [0.3, 0.1, 0.35, 0.2, 0.15, 0.6, 0.25, 0.15, -1.0, 0.25]
    for x, top in zip(np.arange(10) * 2.0, tops, strict=True):
        points = sonar.ping(data, np.random.default_rng(0), X_WS=pose(DOWN, [x, 0.0, 1.5]))
        # 2e-4: chords of round geoms
        within(f"at x = {x} [m]", points[0, 0] - [0.0, 0.0, 1.5 - top], 3e-4)


@pytest.mark.seeds(0, 1)
def test_tiles_and_clusters_leave_nothing_out(seed: int):
    """The same distances as of every ray cast at all triangles."""
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    kinds = [
        mujoco.mjtGeom.mjGEOM_BOX,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    ]
    for i in range(12):
        attitude = {"pos": rng.uniform(-1.0, 1.0, 3), "quat": rng.standard_normal(4)}
        parent = spec.worldbody.add_body(**attitude) if i % 2 else spec.worldbody
        if i % 2:
            parent.add_freejoint()
        parent.add_geom(
            type=kinds[i % 3], size=rng.uniform(0.01, 0.3, 3), **({} if i % 2 else attitude)
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    p_WS, aside = rng.standard_normal((2, 3))
    X_WS = pose(rotation_from_z(-p_WS, aside), rng.uniform(0.3, 2.5) * p_WS / np.linalg.norm(p_WS))
    tangents = np.stack(
        np.meshgrid(np.linspace(-0.6, 0.6, 70), np.linspace(-0.4, 0.4, 50)), axis=-1
    )
    way = np.concatenate([tangents, np.ones((50, 70, 1))], axis=-1)
    start = 0.05 * way + 0.02 * rng.standard_normal(way.shape)
    distance, cosine = VisibleWorld(model).cast(
        X_WS, Rays.of(way, 0.0, start), data.xpos, data.xmat
    )

    vertices, faces, first = [], [], 0
    for geom in range(model.ngeom):
        p, f = tessellate(model, geom)
        vertices.append(p @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
        faces.append(f + first)
        first += len(p)
    scene = RayScene(np.concatenate(vertices), np.concatenate(faces))
    hit = scene.cast(start @ X_WS[:3, :3].T + X_WS[:3, 3], way @ X_WS[:3, :3].T)
    hits = np.isfinite(hit["t"])
    # of 3500: a ray along a silhouette may go either way
    assert (np.isfinite(distance) != hits).sum() <= 7
    both = hits & np.isfinite(distance)
    assert (np.abs(distance[both] - hit["t"][both]) > 1e-4).sum() <= 17
    assert np.all((cosine >= 0.0) & (cosine < 1.0 + 1e-5))


def test_nothing_nearer_than_near_is_seen(within):
    model, data = world(
        '<mujoco><worldbody><geom type="box" size=".01 .01 .005"/><geom type="plane" size="0 0 1" '
        'pos="0 0 -2"/>'
        "</worldbody></mujoco>"
    )
    sonar = Sonar(model, "world", pose(DOWN, [0.0, 0.0, 0.01]), beams=PENCIL, noise=None)
    within(
        "through the housing [m]",
        sonar.ping(data, np.random.default_rng(0))[0, 0] - [0.0, 0.0, 2.01],
        1e-5,
    )


@pytest.mark.parametrize("lean", [0.0, 0.5, 1.0])
def test_first_echo_of_a_leaning_wall(lean: float, within):
    """r = h / cos(lean - a), where a is how far the ring of rays lies off the beam's axis."""
    model, data = wall(np.array([np.sin(lean), 0.0, -np.cos(lean)]), 2.0)
    width = np.deg2rad(1.2)
    beams = SonarBeams(rows=1, columns=1, width=width)
    sonar = Sonar(model, "world", np.eye(4), beams=replace(beams, echo="first"), noise=None)
    r = sonar.ping(data, np.random.default_rng(0))[0, 0, 2]
    off = min(lean, 0.8 * 0.5 * width)
    within("first echo [m]", r - 2.0 * np.cos(lean) / np.cos(lean - off), 2e-5)
    strongest = Sonar(model, "world", np.eye(4), beams=beams, noise=None)
    within(
        "strongest echo [m]", strongest.ping(data, np.random.default_rng(0))[0, 0, 2] - 2.0, 1e-3
    )


def test_footprint_widens_an_edge(within):
    """A plate seen before a wall is wider by 0.8 of half a beam at each side by the first echo; one
    beam in 400.
    """
    model, data = world(
        '<mujoco><worldbody><geom type="box" size=".1 .5 .01" pos="0 0 2.01"/>'
        '<geom type="box" size="3 3 .01" pos="0 0 3"/></worldbody></mujoco>'
    )
    width, fan = np.deg2rad(1.5), np.deg2rad(10.0)
    beams = SonarBeams(rows=1, columns=2001, elevation=0.0, azimuth=fan, width=width)
    kinds: tuple[tuple[Literal["first", "strongest"], float], ...] = (
        ("first", 0.8 * width),
        ("strongest", 0.0),
    )
    for echo, wider in kinds:
        sonar = Sonar(model, "world", np.eye(4), beams=replace(beams, echo=echo), noise=None)
        z = sonar.ping(data, np.random.default_rng(0))[0, :, 2]
        share = fan / 2000 * np.count_nonzero(z < 2.5)
        within(
            f"{echo}: angle of the plate [rad]",
            share - (2.0 * np.arctan(0.1 / 2.0) + wider),
            0.15 * width,
        )


def test_range_noise_is_as_stated(within):
    model, data = wall(np.array([0.0, 0.0, -1.0]), 3.0)
    beams = SonarBeams(width=0.0)
    noise = SonarNoise(outliers=0.0, pointing=0.0)
    sonar = Sonar(model, "world", np.eye(4), beams=beams, noise=noise)
    pings = np.stack([sonar.ping(data, np.random.default_rng(seed)) for seed in range(4)])
    r, true = np.linalg.norm(pings, axis=-1), 3.0 / beams.axes()[..., 2]
    z = (r - true) / np.sqrt((0.003 * true) ** 2 + 0.01**2 / 12.0)
    within("sigma, relative", z.std() - 1.0, 0.03)
    within("bias, in sigmas", z.mean(), 0.03)
    within("whole cells", r / 0.01 - np.rint(r / 0.01), 1e-9)
    within("on the axes of the beams", np.cross(pings, beams.axes()), 1e-9)


def test_pointing_error_shows_on_a_leaning_wall(within):
    """dr = r tan(incidence) times the error of the direction in the plane of incidence."""
    model, data = wall(np.array([np.sin(0.8), 0.0, -np.cos(0.8)]), 2.0)
    width = np.deg2rad(1.2)
    beams = SonarBeams(rows=40, columns=40, elevation=1e-3, azimuth=1e-3, width=width)
    noise = SonarNoise(outliers=0.0, range_share=0.0, range_cell=0.0)
    sonar = Sonar(model, "world", np.eye(4), beams=replace(beams, echo="first"), noise=noise)
    r = np.linalg.norm(sonar.ping(data, np.random.default_rng(0)), axis=-1)
    within("sigma, relative", r.std() / (2.0 * np.tan(0.8) * 0.25 * width) - 1.0, 0.1)


def test_outliers_lie_anywhere_and_grazing_beams_are_silent(within):
    model, data = wall(np.array([np.sin(1.1), 0.0, -np.cos(1.1)]), 2.0)
    noise = SonarNoise(range_share=0.0, range_cell=0.0, pointing=0.0, outliers=0.1)
    beams = SonarBeams(width=0.0)
    sonar = Sonar(model, "world", np.eye(4), beams=beams, noise=noise, range_limits=(0.5, 8.0))
    points = sonar.ping(data, np.random.default_rng(0))
    cosine = -beams.axes() @ np.array([np.sin(1.1), 0.0, -np.cos(1.1)])
    r = np.linalg.norm(points, axis=-1)
    true = 2.0 * np.cos(1.1) / cosine
    answers = (cosine > np.cos(noise.max_incidence)) & (true > 0.5) & (true < 8.0)
    astray = np.isfinite(r) & ~(answers & (np.abs(r - true) < 1e-3))
    within("share of outliers", astray.mean() - 0.1, 0.02)
    within("mean of outliers [m]", r[astray].mean() - 4.25, 0.5)
    assert np.isfinite(r[answers]).all()
    assert 0.05 < np.isfinite(r[~answers]).mean() < 0.15
    assert answers.mean() > 0.2


def test_same_state_same_ping_in_the_step_loop():
    model, _ = world(
        ONE_OF_EACH.replace(
            "<worldbody>", '<worldbody><site name="eye" pos="0 0 1.5" euler="180 0 0"/>'
        )
    )
    sonar, truth = Sonar.at_site(model, "eye", delay=0.1), resting(model)
    assert isinstance(sonar, Sensor)
    first = sonar.init(np.random.default_rng(3))
    second, one = sonar.step(first, truth)
    _, again = sonar.step(first, truth)
    _, other = sonar.step(second, truth)
    assert isinstance(one, SonarScan)
    assert one.points.shape == (72, 96, 3)
    assert not one.points.flags.writeable
    assert np.array_equal(one.points, again.points, equal_nan=True)
    assert not np.array_equal(one.points, other.points, equal_nan=True)


def before_a_barrel() -> tuple[TargetModel, Array, Sonar, mujoco.MjData]:
    """A barrel seen so that both its end and its side show, its pose (4, 4) in S, the sonar, and
    the world's poses.
    """
    target, X_ST, spec = barrel(), camera_pose(np.array([1.0, -0.9, 0.8])), mujoco.MjSpec()
    target.add_to(spec, X_ST)
    model = spec.compile()
    return target, X_ST, Sonar(model, "world", np.eye(4)), resting(model)


def test_barrel_is_found_in_a_sonar_scan(within):
    """With 3 % of the echoes astray."""
    target, X_ST, sonar, truth = before_a_barrel()
    points = sonar.step(sonar.init(np.random.default_rng(0)), truth)[1].points
    clean = without_isolated_echoes(points)
    off = np.abs(np.linalg.norm(clean, axis=-1) - np.linalg.norm(X_ST[:3, 3]))
    assert (np.linalg.norm(points, axis=-1) > 3.0).sum() > 50
    assert np.nanmax(off) < 1.0
    sensor = sonar_model(SonarBeams().pitch)
    identified = identify(
        clean, target, X_ST[:3, 3] + [0.1, -0.1, 0.05], X_ST[:3, :3], sensor=sensor
    )
    assert identified.accepted, identified.reason
    within("position [m]", identified.X_sensor_target[:3, 3] - X_ST[:3, 3], 0.01)  # 0.001


def test_finder_lays_a_path_on_the_median_of_pings(within):
    target, X_ST, sonar, truth = before_a_barrel()
    finder = KnownObjectFinder(
        target,
        "longitudinal",
        X_ST[:3, 3] + 0.05,
        X_ST[:3, :3],
        sensor=sonar_model(SonarBeams().pitch),
        looks=8,
    )
    estimate = standing(np.eye(4))  # W is the sonar's own frame
    heard, scan = sonar.step(sonar.init(np.random.default_rng(1)), truth)
    state, found = finder.step(finder.init(), estimate, scan)
    for _ in range(7):
        assert found is None
        heard, scan = sonar.step(heard, truth)
        state, found = finder.step(state, estimate, scan)
    assert found is not None
    assert found.accepted, found.reason
    assert found.path is not None
    p_T = transform_points(inverse(X_ST), found.path.p)
    # 0.0007
    within("path off the barrel's side [m]", np.linalg.norm(p_T[:, 1:], axis=1) - 0.3, 0.003)
    silence = replace(scan, points=np.full_like(scan.points, np.nan))
    heard_nothing = finder.step(finder.init(), estimate, silence)[1]
    assert heard_nothing is not None
    assert not heard_nothing.accepted


def test_impossible_sonars_are_refused():
    model, data = world(ONE_OF_EACH)
    for make, words in (
        (lambda: Sonar(model, "ship", np.eye(4)), "world"),
        (lambda: Sonar.at_site(model, "nose"), "no site"),
        (lambda: Sonar(model, "world", np.eye(3)), "X_BS"),
        (
            lambda: Sonar(model, "world", np.eye(4)).ping(
                data, np.random.default_rng(0), X_WS=np.eye(3)
            ),
            "X_WS",
        ),
        (
            lambda: Sonar(model, "world", np.eye(4)).step(
                SonarState(seed=0, ping=0), mujoco.MjData(model)
            ),
            "kinematics",
        ),
        (lambda: Sonar(model, "world", np.eye(4), range_limits=(2.0, 1.0)), "range_limits"),
        (lambda: Sonar(model, "world", np.eye(4), delay=-1.0), "delay"),
        (lambda: SonarBeams(echo=untyped("last")), "echo"),
        (lambda: Sonar(model, "world", np.eye(4), visible=Visible(exclude=["leg"])), "leg"),
        (lambda: Sonar(model, "world", np.diag([1.0, 1.0, -1.0, 1.0])), "X_BS: expected a pose"),
        (lambda: SonarBeams(rows=0), "beam"),
        (lambda: SonarBeams(columns=untyped(1.5)), "1.5"),
        (lambda: SonarBeams(azimuth=4.0), "azimuth"),
        (lambda: SonarBeams(width=np.nan), "width"),
        (lambda: without_isolated_echoes(np.zeros((5, 3))), "organised|H, W"),
        (lambda: sonar_model(0.0), "pitch"),
        (lambda: SonarNoise(outliers=2.0), "outliers"),
        (lambda: SonarNoise(range_share=-1.0), "range_share"),
        (lambda: SonarNoise(max_incidence=2.0), "max_incidence"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            make()
