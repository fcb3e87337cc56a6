"""Assessment of a run: its figures, and the bounds that it missed.

If the run ended before a figure could be measured, the figure is None (null in JSON) and counts as
missed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuv.sim.evaluation.energy_metrics import energy_checks, energy_figures
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import OPTIONAL, EveryRun, RunMetrics, Timings
from uuv.sim.interfaces.messages import AbortCode, WorkState
from uuv.sim.runs.saving import write_json

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording


INTERRUPTED = "interrupted"  # state of a run that was ended by a signal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assessment:
    """Metrics of a run compared with the truth, and whether the run is accepted."""

    metrics: Mapping[str, Any]  # as written to metrics.json
    checks: tuple[Requirement, ...]
    failed: tuple[str, ...]  # one line each

    @classmethod
    def of(
        cls,
        recording: "Recording",
        figures: Any,
        checks: Sequence[Requirement],
        *,
        seed: int,
        wall_s: float,
        identification_s: float | None = None,
        others: Iterable[str] = (),
    ) -> "Assessment":
        """Assess a run by its checks. Every run must also be free of collision and end in DONE.

        The metrics consist of `figures`, the metrics that all kinds of run have, and the verdict.
        All values that differ between repetitions are under "timings".

        Args:
            recording: The run.
            figures: Metrics of its kind of work, a dataclass.
            checks: Requirements of its kind of work.
            seed: Seed of the run.
            wall_s: Wall time [s].
            identification_s: Wall time of the last identification [s].
            others: Messages of further failures.

        Returns:
            The assessment.
        """
        # How the run ended: interrupted, at the time limit, or as the work says.
        final = recording.final
        state, note = final.state.value, final.note
        if recording.interrupted:
            note = f"by {recording.interrupted} in state {state} after {recording.duration:.1f} s"
            state = INTERRUPTED

        cut = not recording.interrupted and final.state not in (WorkState.DONE, WorkState.ABORT)
        abort = AbortCode.TIME_LIMIT if cut else final.abort

        run = RunMetrics(
            simulated_s=recording.duration,
            seed=seed,
            state=state,
            note=note,
            abort=None if abort is None else abort.value,
            collision_s=float(recording["collision"].scalar.sum() * recording.timestep),
            trajectory_sha256=recording.digest(),
        )

        timings = Timings(
            wall_s=wall_s,
            real_time_factor=recording.duration / wall_s if wall_s > 0.0 else None,
            identification_s=identification_s,
        )

        # All failures; the cause of the end comes first.
        collision = Requirement("collision", run.collision_s, 0.0, "s")
        failed = [check.failure for check in checks if check.failure]
        if collision.failure:
            first = f": {recording.collided}" if recording.collided else ""
            failed.append(f"{collision.failure}{first}")
        failed += others
        energy = energy_figures(recording)
        checks = (*checks, collision, *energy_checks(energy))

        if recording.interrupted:
            failed.insert(0, f"the run was interrupted {note}")
        elif final.state is WorkState.ABORT and len(recording.events) > 1:
            before = recording.events[-2].state.value
            failed.insert(0, f"the work was aborted in {before} at {final.time:.1f} s: {note}")
        elif final.state is WorkState.ABORT:
            failed.insert(0, f"the run ended in state {state}{f': {note}' if note else ''}")
        elif cut:
            after = f"after {recording.duration:.1f} s, in state {state}"
            failed.insert(
                0, f"the time limit ended the run {after}{f': {note}' if note else ''} (--longest)"
            )

        ended = EveryRun(
            run=run, accepted=not failed, failed=failed, timings=timings, energy=energy
        )
        entries = {**asdict(figures), **asdict(ended)}
        # for two of these fields see `made_by` and `started`
        metrics = {name: e for name, e in entries.items() if e is not None or name not in OPTIONAL}
        return cls(metrics=metrics, checks=checks, failed=tuple(failed))

    @property
    def accepted(self) -> bool:
        """True if nothing failed."""
        return not self.failed

    def made_by(self, provenance: Mapping[str, Any]) -> "Assessment":
        """Copy with `provenance` among the metrics."""
        return self.extended(provenance=dict(provenance))

    def extended(self, **entries: Any) -> "Assessment":
        """Copy with further entries among the metrics, of those that `EveryRun` lists."""
        return replace(self, metrics={**self.metrics, **entries})

    def write(self, file: Path) -> None:
        """Write metrics.json.

        Raises:
            ConfigurationError: The file cannot be written.
        """
        write_json(file, self.metrics)
