"""The flat port against Snell's and Fermat's laws, and what calibrations make of what is seen
through it.
"""

import mujoco
import numpy as np
import pytest
from scipy import optimize

from untyped import untyped
from uuv.clouds.frames import resting
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import Array
from uuv.sim.sensors.depth_camera import DepthCamera, Optics
from uuv.sim.sensors.refraction import FlatPort, PortCalibration, in_air, in_water

FOCAL = 554.0
THIN = FlatPort(distance=0.0, thickness=0.0)
GLASSLESS = FlatPort(distance=0.02, thickness=0.0)


def wall(z: float, **options: object) -> DepthImage:
    """A frame of a wall square to the optical axis at depth `z` [m]."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, z], quat=[0, 1, 0, 0]
    )
    model = spec.compile()
    camera = DepthCamera(model, "world", np.eye(4), noise=None, optics=Optics(**untyped(options)))
    return camera.step(camera.init(np.random.default_rng(0)), resting(model))[1]


def error(image: DepthImage, z: float) -> Array:
    """Depth read [m] less the true one, from where the frame says that the camera is."""
    return image.depth - (z - image.X_BC[2, 3])


@pytest.mark.parametrize(
    ("angle", "share"), [(1e-6, 0.750), (10.0, 0.741), (20.0, 0.711), (30.0, 0.646)]
)
def test_share_of_the_depth_that_is_left_by_a_calibration_in_air(
    angle: float, share: float, within
):
    """tan w / tan a with sin a = n sin w, for points seen `angle` [deg] off the axis in water."""
    w = np.deg2rad(angle)
    closed = np.tan(w) / np.tan(np.arcsin(1.333 * np.sin(w)))
    within("closed form", np.tan(w) / THIN.tangent(np.tan(w), 1.0) - closed, 1e-12)
    within("published table", closed - share, 6e-4)


def test_snell_at_both_faces(within):
    port = FlatPort(distance=0.015, thickness=0.012)
    t = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 2))
    start, way = port.rays(t)
    sine = [v / np.hypot(v, 1.0) for v in (np.hypot(*t.T), np.hypot(*(way[:, :2]).T))]
    within("sin a = n sin w", sine[0] - 1.333 * sine[1], 1e-12)
    glass = (start[:, :2] - 0.015 * t) / 0.012
    r = np.hypot(*glass.T)
    within("sin a = n sin g", sine[0] - 1.49 * r / np.hypot(r, 1.0), 1e-12)
    within("in one plane", np.cross(np.c_[t, np.ones(50)], way)[:, 2], 1e-12)
    beyond = start + way * np.linspace(0.01, 4.0, 50)[:, None]
    within(
        "and back", port.tangent(np.hypot(*beyond[:, :2].T), beyond[:, 2]) - np.hypot(*t.T), 1e-10
    )


def test_light_takes_the_fastest_way(within):
    """Fermat: the way through air, glass and water that takes least time leaves the lens at the
    tangent found.
    """
    port = FlatPort(distance=0.03, thickness=0.02)
    for rho, z in ((0.1, 0.3), (0.5, 1.0), (2.0, 1.5)):

        def time(p: Array, rho: float = rho, z: float = z) -> float:
            return (
                np.hypot(p[0], 0.03)
                + 1.49 * np.hypot(p[1] - p[0], 0.02)
                + 1.333 * np.hypot(rho - p[1], z - 0.05)
            )

        best = optimize.minimize(
            time, [0.01, 0.02], method="Nelder-Mead", options={"xatol": 1e-11, "fatol": 1e-16}
        )
        # 2e-6: flat minimum
        within(f"tangent at {rho}, {z} m", best.x[0] / 0.03 - float(port.tangent(rho, z)), 3e-5)


def test_effective_focal_length_depends_on_range(within):
    """f'/f = z / (d + (z - d) / n) on the axis: 1.316 at 0.5 m, 1.329 at 2 m for a lens 20 mm
    behind the port.
    """
    for z, known in ((0.5, 1.316), (2.0, 1.329)):
        ratio = GLASSLESS.tangent(1e-6, z) / (1e-6 / z)
        within("closed form", ratio - z / (0.02 + (z - 0.02) / 1.333), 1e-9)
        within("published", ratio - known, 6e-4)


def test_calibration_near_the_axis_in_closed_form(within):
    """There the port makes an exact pinhole: n f, behind the lens by d (n - 1) + t (n / n_glass -
    1).
    """
    port = FlatPort(distance=0.02, thickness=0.01)
    camera = in_water(port, FOCAL, corner=2.0)
    within("focal length, relative", camera.focal / (1.333 * FOCAL) - 1.0, 1e-5)
    within("centre [m]", camera.center + 0.02 * 0.333 + 0.01 * (1.333 / 1.49 - 1.0), 1e-5)


@pytest.mark.parametrize("z", [0.6, 1.5])
def test_reading_with_the_calibration_of_air(z: float, within):
    """Left ray straight on, the right one at atan(b / z) in water: depth = b / tan(asin(n
    sin(atan(b / z)))).
    """
    image = wall(z, port=THIN, calibration=in_air(FOCAL), width=641, height=481)
    closed = 0.12 / np.tan(np.arcsin(1.333 * np.sin(np.arctan(0.12 / z))))
    within("middle [m]", image.depth[240, 320] - closed, 1e-6)
    within("K", image.K[0, 0] - FOCAL, 1e-12)
    with np.errstate(invalid="ignore"):
        assert np.nanmax(image.depth) < 0.76 * z


def test_a_port_that_bends_nothing_changes_nothing(within):
    clear = FlatPort(n_water=1.0, n_glass=1.0)
    for calibration in (None, in_air(FOCAL)):
        image = wall(1.3, port=clear, calibration=calibration)
        within("depth [m]", error(image, 1.3), 1e-5)
        within("K [px]", image.K[0, 0] - FOCAL, 1e-3)


def test_better_calibrations_read_better():
    """Air is wrong by a quarter and more, water with the lens for centre by centimetres, water by
    millimetres.
    """
    port = FlatPort()
    kinds = (
        in_air(FOCAL),
        in_water(port, FOCAL, 400.0, move_center=False),
        in_water(port, FOCAL, 400.0),
    )
    rms = [
        float(np.sqrt(np.nanmean(error(wall(2.0, port=port, calibration=c), 2.0) ** 2)))
        for c in kinds
    ]
    assert rms[0] > 0.5  # 0.62
    assert 0.005 < rms[1] < 0.03  # 0.011
    assert rms[2] < 0.006  # 0.003
    default = wall(2.0, port=port)
    assert np.sqrt(np.nanmean(error(default, 2.0) ** 2)) == pytest.approx(rms[2])


def test_behind_a_port_nothing_is_seen_where_nothing_is():
    """Of an odd number of pixels the middle one looks straight ahead, where 0 times inf is no
    number.
    """
    model = mujoco.MjSpec().compile()
    camera = DepthCamera(
        model, "world", np.eye(4), optics=Optics(width=65, height=49, port=FlatPort())
    )
    bodies = resting(model)
    assert np.isinf(camera.render(bodies.xpos, bodies.xmat)[0]).all()


def test_impossible_ports_are_refused():
    for make, words in (
        (lambda: FlatPort(distance=-0.1), "distance"),
        (lambda: FlatPort(thickness=np.nan), "thickness"),
        (lambda: FlatPort(n_water=0.9), "n_water"),
        (lambda: FlatPort().tangent(0.1, 0.01), "beyond the port"),
        (lambda: PortCalibration(focal=-1.0), "focal"),
        (lambda: PortCalibration(focal=1.0, k1=np.nan), "finite"),
        (lambda: in_water(FlatPort(), FOCAL, 400.0, ranges=()), "ranges"),
        (lambda: in_water(FlatPort(), FOCAL, 400.0, ranges=(0.01,)), "in the water"),
        (lambda: Optics(calibration=in_air(FOCAL)), "port"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            make()
