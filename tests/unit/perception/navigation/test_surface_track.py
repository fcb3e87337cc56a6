"""Camera on the arm in navigation: the track against a batch solution, loss, outliers, unobserved
directions.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv.models.arms.serial_arm import SerialArm
from uuv.perception.navigation.filter_kernel import AT_TRACK, STATES
from uuv.perception.navigation.strapdown_filter import Navigation, NavigationState
from uuv.perception.navigation.surface_track import TrackMount
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    EncoderMeasurement,
    ImuMeasurement,
    Measurement,
    SurfaceMotionMeasurement,
    ToolAtRest,
    TorqueMeasurement,
    VisionMeasurement,
    VisionNoise,
)
from uuv.sim.interfaces.spatial import GRAVITY, Array, pose

STEP = 0.01  # [s]
Q = np.array([0.3, -0.4])
ARM = SerialArm.from_dh([[0.0, 0.2, 0.0, np.pi / 2], [0.0, 0.0, 0.6, 0.0]])
MOUNT = TrackMount(arm=ARM, X_BA=pose(p=[0.3, 0.0, -0.4]), X_GC=pose(p=[0.1, 0.0, -0.15]))
R_WC = MOUNT.pose(Q)[:3, :3]  # the hull is level and still
SIGMA = 1e-4  # [m]


def imu(k: int) -> ImuMeasurement:
    force = np.array([1e-9 * k, 0.0, GRAVITY])
    return ImuMeasurement(time=k * STEP, specific_force_B=force, w_WB_B=np.zeros(3), R_WB=np.eye(3))


def vision(k: int, p: Array, wander: float = 0.0) -> VisionMeasurement:
    return VisionMeasurement(
        time=k * STEP, p_WB=p, noise=VisionNoise(white=2e-3, wander=wander, wander_time=10.0)
    )


def track(
    k: int, key: int, moved_W: Array, information: Array | None = None
) -> SurfaceMotionMeasurement:
    """Reading at step k of a hull that has moved by `moved_W` since step `key`."""
    L = np.eye(3) / SIGMA**2 if information is None else information
    return SurfaceMotionMeasurement(
        time=k * STEP,
        key_time=key * STEP,
        p_KC=R_WC.T @ moved_W,
        R_KC=np.eye(3),
        information_K=R_WC.T @ L @ R_WC,
        q=Q,
    )


def begun(first: Array, wander: float = 0.0) -> tuple[Navigation, NavigationState]:
    navigation = Navigation(arm_camera=MOUNT, adapt=False)
    body = [
        EncoderMeasurement(time=0.0, q=Q, qd=np.zeros(2)),
        TorqueMeasurement(time=0.0, tau=np.zeros(2)),
    ]
    return navigation, navigation.init([imu(0), vision(0, first, wander), *body])


def offset(state: NavigationState) -> slice:
    first = int(state.memory["layout"][0, AT_TRACK])
    return slice(first, first + 3)


def test_a_track_holds_the_estimate_where_it_began_and_vision_adds_its_mean(rng):
    """A still hull: with the track the error falls as that of a mean of all pictures, with no
    vision it stays.
    """
    errors = {}
    for tracked in (True, False):
        noise = np.random.default_rng(3)
        navigation, state = begun(2e-3 * noise.standard_normal(3))
        estimate = None
        for k in range(1, 2001):
            messages: list[Measurement] = [imu(k)]
            if k % 10 == 0:
                messages.append(vision(k, 2e-3 * noise.standard_normal(3)))
            if tracked and k % 5 == 0 and k >= 100:
                messages.append(
                    track(k, 100, SIGMA * rng.standard_normal(3) if k > 100 else np.zeros(3))
                )
            state, estimate = navigation.step(state, messages)
        assert estimate is not None
        errors[tracked] = float(np.sqrt(np.mean(estimate.position_sigma**2)))
        assert np.linalg.norm(state.x[:3]) < 5.0 * np.sqrt(3.0) * errors[tracked]
    mean = 2e-3 / np.sqrt(200.0)
    assert errors[True] == pytest.approx(mean, rel=0.15)  # measured 1.4e-4
    assert errors[False] > 2.0 * errors[True]


def test_relative_motion_is_known_to_the_track_and_the_covariance_stays_consistent():
    """Position plus offset has the track's noise, whatever the place is worth; the matrix stays
    positive.
    """
    navigation, state = begun(np.zeros(3))
    for k in range(1, 300):
        state, _ = navigation.step(
            state, [imu(k), *([track(k, 100, np.zeros(3))] if k >= 100 and k % 5 == 0 else [])]
        )
    o = offset(state)
    n = int(state.memory["layout"][0, STATES])
    P = state.P
    relative = P[:3, :3] + P[:3, o] + P[o, :3] + P[o, o]
    assert np.all(np.sqrt(np.diag(relative)) < SIGMA)
    assert np.all(np.sqrt(np.diag(P))[:3] > 1e-3)
    assert np.linalg.eigvalsh(P[:n, :n]).min() > -1e-12


def test_a_direction_without_information_is_left_to_the_others():
    """Along x nothing is observed: the estimate there is bit for bit as good as without the
    camera.
    """
    unseen = np.diag([0.0, 1.0, 1.0]) / SIGMA**2
    sigmas = []
    for tracked in (True, False):
        navigation, state = begun(np.zeros(3))
        for k in range(1, 400):
            messages: list[Measurement] = [
                imu(k),
                *([vision(k, np.array([1e-6 * k, 0.0, 0.0]))] if k % 10 == 0 else []),
            ]
            if tracked and k % 5 == 0:
                lie = np.array([0.5, 0.0, 0.0])  # what such a direction reads means nothing
                messages.append(track(k, 5, lie if k > 5 else np.zeros(3), unseen))
            state, _ = navigation.step(state, messages)
        sigmas.append(np.sqrt(np.diag(state.P)[:3]))
        assert abs(state.estimate.X_WB[0, 3]) < 1e-3
    assert sigmas[0][0] == pytest.approx(sigmas[1][0], rel=1e-9)
    assert sigmas[0][1] < sigmas[1][1]


def test_where_vision_wanders_the_estimate_stays_with_the_object():
    """Vision that slides by 10 mm: without the camera the estimate follows, with it the tool
    stays.
    """
    ends = []
    for tracked in (True, False):
        navigation, state = begun(np.zeros(3), wander=1e-2)
        for k in range(1, 1500):
            p = np.array([1e-2 * min(1.0, max(0.0, (k - 300) / 600)), 1e-6 * k, 0.0])
            messages: list[Measurement] = [imu(k), *([vision(k, p, 1e-2)] if k % 10 == 0 else [])]
            if tracked and k % 5 == 0 and k >= 100:
                messages.append(track(k, 100, np.zeros(3)))
            state, _ = navigation.step(state, messages)
        ends.append(abs(float(state.estimate.X_WB[0, 3])))
    assert ends[0] < 2e-4  # measured below 1e-4
    assert ends[1] > 10.0 * ends[0]


def test_outliers_are_refused_and_readings_that_agree_begin_a_new_track():
    navigation, state = begun(np.zeros(3))
    for k in range(1, 401):
        wrong = np.array([0.05, 0.0, 0.0]) if k in (200, 205) or k > 300 else np.zeros(3)
        messages: list[Measurement] = [
            imu(k),
            *([vision(k, np.array([1e-6 * k, 0.0, 0.0]))] if k % 10 == 0 else []),
        ]
        if k % 5 == 0:
            messages.append(track(k, 5, wrong if k > 5 else np.zeros(3)))
        state, estimate = navigation.step(state, messages)
        if k == 300:
            assert state.track is not None
            assert (state.track.refused, state.track.begun) == (2, 1)
        assert abs(estimate.X_WB[0, 3]) < 1e-3
    assert state.track is not None
    assert state.track.begun == 2


def test_a_track_goes_on_over_key_pictures_and_breaks_off_with_a_gap():
    navigation, state = begun(np.zeros(3))
    for k in range(5, 400):
        messages: list[Measurement] = [imu(k)]
        # keys at 5, 100, 200; the message that links the key at 205 to them is lost
        if k % 5 == 0 and k != 205:
            key = 5 if k <= 100 else 100 if k <= 200 else 205
            messages.append(track(k, key, np.zeros(3)))
        state, _ = navigation.step(state, messages)
        if k == 200:
            assert state.track is not None
            assert state.track.begun == 1
    assert state.track is not None
    assert state.track.begun == 2


def test_messages_that_are_not_sound_or_out_of_time_change_nothing():
    navigation, state = begun(np.zeros(3))
    for k in range(1, 200):
        state, _ = navigation.step(
            state, [imu(k), *([track(k, 5, np.zeros(3))] if k % 5 == 0 else [])]
        )
    before = state.memory.copy()
    good = track(195, 5, np.zeros(3))
    bad = [
        replace(good, time=float("nan")),
        replace(good, p_KC=np.full(3, np.nan)),
        replace(good, time=-5.0),
        good,
    ]
    assert state.track is not None
    for message in bad:
        state.track.take(message)
    assert state.track.refused == len(bad)
    assert before.tobytes() == state.memory.tobytes()


def test_without_a_mount_a_message_is_ignored():
    navigation = Navigation()
    body = [
        EncoderMeasurement(time=0.0, q=Q, qd=np.zeros(2)),
        TorqueMeasurement(time=0.0, tau=np.zeros(2)),
    ]
    state = navigation.init(
        [imu(0), vision(0, np.zeros(3)), DvlMeasurement(time=0.0, v_WB_B=np.zeros(3)), *body]
    )
    state, _ = navigation.step(state, [imu(1), track(1, 1, np.zeros(3))])
    assert state.track is None


def at_rest(k: int, since: int, q: Array = Q) -> ToolAtRest:
    """A tool that stands since a step, and may have slipped by 0.1 mm."""
    return ToolAtRest(time=k * STEP, since=since * STEP, q=q, slip_sigma=1e-4)


def standing(said: bool, *, slips: float = 0.0) -> NavigationState:
    """A still hull, no Doppler log; its tool stands for half a second, or `slips` by a turn [rad]
    of the joints.
    """
    navigation = Navigation(
        standing=TrackMount(arm=ARM, X_BA=MOUNT.X_BA, X_GC=np.eye(4)), adapt=False
    )
    body = [
        EncoderMeasurement(time=0.0, q=Q, qd=np.zeros(2)),
        TorqueMeasurement(time=0.0, tau=np.zeros(2)),
    ]
    state = navigation.init([imu(0), vision(0, np.zeros(3)), *body])
    noise = np.random.default_rng(5)
    for k in range(1, 202):
        messages: list[Measurement] = [imu(k)]
        if k % 10 == 0:
            messages.append(vision(k, 2e-3 * noise.standard_normal(3)))
        if said and k in (150, 200):
            messages.append(at_rest(k, 150, Q + (slips if k == 200 else 0.0)))
        state, _ = navigation.step(state, messages)
    return state


def test_a_tool_at_rest_tells_how_fast_the_hull_moves():
    """Its stated slip over half a second is 0.2 mm/s; vision alone knows the speed to some mm/s."""
    speeds = [np.sqrt(np.diag(standing(standing_still).P)[3:6]) for standing_still in (True, False)]
    assert np.all(speeds[0] < 4e-4)  # measured 3.7e-4 m/s, and 2.7e-3 without
    assert np.all(speeds[1] > 5.0 * speeds[0])
    assert np.linalg.norm(standing(True).x[3:6]) < 4.0 * np.linalg.norm(speeds[0])


def test_a_tool_that_slips_all_the_same_is_not_believed():
    """A joint that turned by 0.2 rad means 10 cm of the tool: refused, and nothing of the filter
    has changed.
    """
    believed = standing(True)
    refused = standing(True, slips=0.2)
    assert believed.track is not None
    assert refused.track is not None
    assert (believed.track.refused, refused.track.refused) == (0, 1)
    assert np.linalg.norm(refused.x[3:6]) < 0.01
