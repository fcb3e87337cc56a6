"""The visual log can be read back: closed, after an exception, and after a kill in the middle of
writing.
"""

import signal
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models.objects.targets import barrel
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    Command,
    ContactEstimate,
    DepthImage,
    HullLoad,
    Reference,
    StateEstimate,
    Target,
    ToolPath,
    WorkState,
)
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import pose, transform_points
from uuv.sim.loop.rollout import Moment
from uuv.sim.reporting import rerun_stream
from uuv.sim.reporting.rerun_log import RerunLog

X_WT = pose(p=[1.0, 0.1, -1.5])
PERIOD = 0.002  # [s]
DEPTH = DepthImage(
    time=0.2, depth=np.full((48, 64), 1.5), K=np.diag([50.0, 50.0, 1.0]), X_BC=np.eye(4)
)


def scene() -> mujoco.MjModel:
    spec = models.load("uuv_puma")
    barrel().add_to(spec, X_WT)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.1], pos=[0.0, 0.0, -2.3]
    )
    return spec.compile()


def moments(model: mujoco.MjModel):
    """An endless run on a path along the barrel, at the physics rate, without physics."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    line = barrel().path("longitudinal")
    n = len(line.p)
    path = ToolPath(
        s=np.arange(float(n)),
        p=transform_points(X_WT, line.p),
        z=np.array(line.a),
        x=np.array(line.b),
        on_scan=np.zeros(n, dtype=bool),
    )
    doubt = PoseCovariance(
        matrix=1e-6 * np.eye(6),
        free=np.zeros((0, 6)),
        center=X_WT[:3, 3],
        radius=0.5,
        size_sigma=1.0,
    )
    target = Target(
        time=0.0,
        X_WT=X_WT,
        accepted=True,
        check_m=0.001,
        range_m=1.2,
        reason="",
        path=path,
        covariance=doubt,
    )
    truth = SimpleNamespace(
        time=0.0,
        contact_normal=60.0,
        p_pad=np.zeros(3),
        R_WG=np.eye(3),
        R_WB=np.eye(3),
        p_WB=np.zeros(3),
        contact_force_W=np.array([0.0, 0.0, 60.0]),
        xpos=data.xpos,
        xquat=data.xquat,
        q=np.zeros(6),
        tau_drive=np.zeros(6),
        thrust=np.zeros(6),
        current_W=np.array([0.15, 0.0, 0.0]),
    )
    zero = np.zeros(6)
    estimate = StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=np.zeros(3),
        w_WB_B=np.zeros(3),
        a_WB_B=np.zeros(3),
        q=zero,
        qd=zero,
        tau=zero,
    )
    contact = ContactEstimate(normal=59.0)
    load = HullLoad(arm_wrench_B=np.array([0.0, 0.0, -80.0, 0.0, 0.0, 0.0]))
    command = Command(
        time=0.0, joint_torque=zero, thrusters=zero, scan=False, contact=contact, hull_load=load
    )
    tick = 0
    while True:
        truth.time = tick * PERIOD
        truth.p_pad[:] = [0.02 * truth.time, 0.0, -1.2]
        reference = Reference(
            time=truth.time,
            state=WorkState.SCAN if truth.time < 0.5 else WorkState.WORK,
            X_WB=np.eye(4),
            v_WB_W=np.zeros(3),
            X_WG=pose(p=truth.p_pad),
            v_WG_W=np.array([0.02, 0.0, 0.0]),
            w_WG_W=np.zeros(3),
            q=zero,
            qd=zero,
            set_force=60.0,
            force_control=True,
            tare=False,
            scan=False,
            path_s=0.02 * truth.time,
            target=target if truth.time > 0.4 else None,
        )
        yield Moment(tick, truth, estimate, target, reference, command, None, None)
        tick += 1


def last_times(file: Path) -> dict[str, float]:
    """The last sim_time [s] of every entity in `file`, -inf for what is static."""
    from rerun.chunk import RrdReader

    last: dict[str, float] = defaultdict(lambda: -np.inf)
    for chunk in RrdReader(file).stream().to_chunks():
        batch = chunk.to_record_batch()
        times = (
            batch.column("sim_time").cast("int64").to_numpy() * 1e-9
            if "sim_time" in batch.schema.names
            else []
        )
        last[chunk.entity_path] = max(last[chunk.entity_path], *times, -np.inf)
    return dict(last)


def test_closed_log_holds_everything_up_to_its_end(tmp_path: Path):
    file = tmp_path / "run.rrd"
    model = scene()
    with RerunLog(file, model, bounds=Bounds()) as log:
        log.log_cloud("scan", np.random.default_rng(0).normal(size=(100, 3)), 0.1)
        log.log_mesh("seabed", np.eye(3), [[0, 1, 2]], 0.2)
        log.log_arrows("axes", np.zeros((2, 3)), np.ones((2, 3)), 0.3)
        for moment in moments(model):
            looks = 0.2 < moment.truth.time < 0.21
            log.observe(replace(moment, frame=DEPTH) if looks else moment)
            if moment.truth.time > 2.0:
                break
    last = last_times(file)
    series_shown = (
        "force path_error path_error/bound hull_drift thrust joint_angle joint_torque navigation"
    )
    for series in series_shown.split():
        assert last[f"/series/{series}"] == pytest.approx(2.0)
    # ellipsoids of the find, and of the mean once the work goes by it
    for suffix in ("", "_enlarged"):
        assert last[f"/world/uncertainty/found{suffix}"] == pytest.approx(0.0)
        assert last[f"/world/uncertainty/mean{suffix}"] == pytest.approx(0.4, abs=0.01)
    for entity in (
        "vehicle/hull",
        "vehicle/link3",
        "arrows/contact",
        "arrows/arm_on_hull",
        "arrows/current",
        "arrows/jets",
        "path/done",
    ):
        assert last[f"/world/{entity}"] == pytest.approx(2.0)
    assert last["/world/path/planned"] == 0.0
    assert last["/world/camera"] == pytest.approx(0.202)
    assert last["/world/camera/depth"] == pytest.approx(0.5)  # taken away when the scan is over
    assert last["/world/clouds/scan"] == pytest.approx(0.1)
    assert last["/world/found/seabed"] == pytest.approx(0.2)
    assert last["/world/found/axes"] == pytest.approx(0.3)
    assert last["/state/now"] == pytest.approx(0.5)
    for entity in ("vehicle/hull/shape", "scene/target/shape", "scene/world/shape"):
        assert last[f"/world/{entity}"] == -np.inf


def test_exception_in_the_run_leaves_a_whole_log(tmp_path: Path):
    file = tmp_path / "run.rrd"
    model = scene()

    def run() -> None:
        with RerunLog(file, model) as log:
            for moment in moments(model):
                log.observe(moment)
                if moment.truth.time > 1.0:
                    raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    last = last_times(file)
    assert last["/series/force"] == pytest.approx(1.0)
    # none was given: its colour is there, no value
    assert last["/series/path_error/bound"] == -np.inf


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.parametrize("full", [True, False])
def test_log_that_cannot_be_written_is_given_up_in_one_line(
    full: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """As Rerun does on a full disk: from then on every flush raises. What came before can be read;
    room is made where the disk is full.
    """
    file = tmp_path / "run.rrd"
    model = scene()
    if full:
        monkeypatch.setattr(rerun_stream, "ROOM", 100)
        monkeypatch.setattr(rerun_stream.shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
    whole = 0
    with RerunLog(file, model) as log:
        for moment in moments(model):
            log.observe(moment)
            if moment.tick == 500:
                log.flush()
                whole = file.stat().st_size
                monkeypatch.setattr(log._stream, "_stream", FullDisk(log._stream._stream))
                log.flush()
            if moment.truth.time > 2.0:
                break
        log.log_cloud("scan", np.zeros((3, 3)), 2.0)
    message = capsys.readouterr().err
    reason = "no space left" if full else "File-writer thread shut down prematurely"
    assert message == f"run log: lost from 1.0 s on, the run continues ({reason}): {file}\n"
    assert file.stat().st_size <= whole - 100 if full else file.stat().st_size == whole
    assert 0.0 < last_times(file)["/series/force"] <= 1.0


class FullDisk:
    """A stream whose writer has stopped."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def flush(self, **_: Any) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # which only a closed file can have
def test_killed_run_loses_less_than_a_second(tmp_path: Path):
    file = tmp_path / "run.rrd"
    # The child runs at 5 times real time and tells how far it is.
    with subprocess.Popen(
        [sys.executable, __file__, str(file)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
        env={"PYTHONPATH": "."},
    ) as child:
        assert child.stdout is not None
        reached = 0.0
        for line in child.stdout:
            reached = float(line)
            if reached > 8.0:
                child.send_signal(signal.SIGKILL)
                break
    last = last_times(file)
    lost = reached - last["/series/force"]
    assert 0.0 <= lost < 5.0, f"{lost:.2f} s of a run at 5 times real time"
    assert last["/world/vehicle/link6"] == pytest.approx(last["/series/force"], abs=0.05)


def test_log_refuses_a_missing_folder(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="no folder"):
        RerunLog(tmp_path / "nowhere" / "run.rrd", scene())


def run_until_killed(file: Path) -> None:
    model = scene()
    log = RerunLog(file, model)
    began = time.perf_counter()
    for moment in moments(model):
        log.observe(moment)
        ahead = moment.truth.time / 5.0 - (time.perf_counter() - began)
        if moment.tick % 50 == 0:
            print(moment.truth.time, flush=True)
            time.sleep(max(0.0, ahead))


if __name__ == "__main__":
    run_until_killed(Path(sys.argv[1]))
