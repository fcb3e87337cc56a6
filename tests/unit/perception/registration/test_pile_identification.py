"""The pile: its mesh against its closed form and its contact shape, its paths, and what one look
can tell of it.
"""

import mujoco
import numpy as np
import pytest

from depth_scenes import coarse, look
from uuv.clouds.frames import camera_pose
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.objects.targets import (
    PILE_DIAMETER,
    PILE_LENGTH,
    ModelPath,
    helix,
    pile,
    ring,
    vertical,
)
from uuv.perception.clouds.scan import Scan
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose

PILE = pile()
R = 0.5 * PILE_DIAMETER


def test_mesh_is_closed_and_wound_outwards(within):
    v, t = PILE.vertices, PILE.triangles
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges}
    assert len(directed) == len(edges)
    assert all((b, a) in directed for a, b in directed)
    volume = np.einsum("ij,ij->", v[t[:, 0]], np.cross(v[t[:, 1]], v[t[:, 2]])) / 6.0
    # 256 sides: 1e-4
    within("volume", volume / (np.pi * (0.3**2 * 2.9 + 0.38**2 * 0.1)) - 1.0, 1.1e-3)
    assert np.ptp(v, axis=0) == pytest.approx([0.76, 0.76, PILE_LENGTH])
    assert PILE.center == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_picture_and_contact_agree(within):
    """Rays at the mesh and at MuJoCo's primitives end within a millimetre, at the flange too."""
    spec = mujoco.MjSpec()
    PILE.add_to(spec, pose())
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    azimuth, height = rng.uniform(-np.pi, np.pi, 300), rng.uniform(-1.45, 1.45, 300)
    outward = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(300)])
    start = outward + height[:, None] * [0.0, 0.0, 1.0]
    scene = RayScene(PILE.vertices, PILE.triangles)
    seen = scene.cast(start, -outward)["t"]
    hit = np.zeros(1, dtype=np.int32)
    felt = [mujoco.mj_ray(model, data, start[i], -outward[i], None, 1, -1, hit) for i in range(300)]
    within("distance [m]", seen - felt, 1e-3)
    assert sorted(np.unique(np.round(felt, 3))) == pytest.approx([0.62, 0.7])


@pytest.mark.parametrize(
    ("path", "length"),
    [
        (vertical(0.4, 0.7, -0.5), 0.4),
        (vertical(0.3, -2.0, 0.8), 0.3),
        (ring(2.0, 0.3, -0.9), 2.0 * R),
        (ring(2.0 * np.pi, 0.0, 0.5), 2.0 * np.pi * R),
        (helix(1.5, 0.4, 0.2, -0.3), np.hypot(1.5 * R, 0.4)),
        (helix(4.0, -0.5, 0.2, -0.6), np.hypot(4.0 * R, 0.5)),
    ],
)
def test_paths_lie_on_the_shell_and_press_into_it(path: ModelPath, length: float, within):
    within(
        "length [m]", np.linalg.norm(np.diff(path.p, axis=0), axis=1).sum() - length, 1e-4 * length
    )
    within("radius [m]", np.linalg.norm(path.p[:, :2], axis=1) - R, 1e-12)
    within("tool axis", path.a + path.p * [1, 1, 0] / R, 1e-12)
    step = np.gradient(path.p, axis=0)
    within(
        "b along the path",
        np.cross(path.b, step / np.linalg.norm(step, axis=1, keepdims=True)),
        1e-2,
    )
    assert np.all(np.einsum("ij,ij->i", path.b, step) > 0.0)


def test_paths_are_where_they_are_asked_for():
    for path in (vertical(0.4, 0.7, -0.5), ring(1.0, 0.7, -0.5), helix(1.0, 0.4, 0.7, -0.5)):
        middle = 0.5 * (path.p[0] + path.p[-1])
        assert middle[2] == pytest.approx(-0.5)
        assert np.arctan2(middle[1], middle[0]) == pytest.approx(0.7)
    assert vertical().p[-1, 2] > vertical().p[0, 2]  # up
    assert helix(1.0, -0.4).p[-1, 2] < helix(1.0, -0.4).p[0, 2]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: vertical(0.0), "length must be > 0 m"),
        (lambda: vertical(0.5, height=0.25), "clear of the flange"),
        (lambda: vertical(0.5, height=0.0), "clear of the flange"),  # 5 cm under it, 8 cm asked for
        (lambda: vertical(2.9), "clear of the"),
        (lambda: vertical(0.4, height=float("nan")), "got nan"),
        (lambda: ring(0.0), "arc"),
        (lambda: ring(7.0), "arc"),
        (lambda: ring(1.0, height=0.25), "flange"),
        (lambda: helix(-1.0), "arc"),
        (lambda: helix(1.0, 0.9), "flange"),
    ],
)
def test_paths_off_the_shell_are_refused(make, words):
    with pytest.raises(ConfigurationError, match=words):
        make()


def test_flange_tells_the_height(within):
    """1.7 to 1.9 m off, both ends out of view. In 46 the flange slides out of the picture unless
    more starts are tried.

    Now and then (7 and 21 of the first 60 seeds) a right pose is refused, its shape 0.1 to 0.3 mm
    over the limit.
    """
    surface, errors = ModelSurface.of(PILE), []
    for seed in (0, 1, 46):
        rng = np.random.default_rng(seed)
        heading, height, distance = rng.uniform([-np.pi, -0.2, 1.7], [np.pi, 0.2, 1.9])
        outward = np.array([np.cos(heading), np.sin(heading), 0.0])
        X_CT = camera_pose(distance * outward + [0, 0, height], np.array([0.0, 0.0, height]))
        image = look(PILE, X_CT, rng, floor=False)
        result = identify(Scan.from_depth(image), surface, *coarse(rng, X_CT, PILE))
        assert result.accepted, f"seed {seed}: {result.reason}"
        assert len(result.symmetry.twists) == 1  # to turn about the pile's axis, and no more
        errors.append(PILE.symmetry.error(result.X_sensor_target, X_CT))
    position, angle = np.array(errors).T
    within("position [m]", position, 5e-3)
    within("axis [rad]", angle, np.deg2rad(0.5))


@pytest.mark.long
def test_a_plain_pile_is_not_said_to_be_known():
    """Without the flange the model slides along what is seen: no height, no acceptance."""
    plain = pile(flange=False)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        X_CT = camera_pose(np.array([1.8, 0.0, 0.0]))
        image = look(plain, X_CT @ pose(exp_so3([0.0, 0.0, seed])), rng, floor=False)
        result = identify(Scan.from_depth(image), plain, *coarse(rng, X_CT, plain))
        assert not result.accepted
        assert "slide" in result.reason
        assert len(result.symmetry.twists) == 2


def test_the_flange_out_of_view_is_not_guessed():
    rng = np.random.default_rng(0)
    at = np.array([0.0, 0.0, -0.75])
    X_CT = camera_pose(at + np.array([1.2, 0.0, 0.0]), at)
    image = look(PILE, X_CT, rng, floor=False)
    result = identify(Scan.from_depth(image), PILE, X_CT[:3, 3] + 0.1, X_CT[:3, :3])
    assert not result.accepted
