"""Cost of a step: which models take turns, and what the page makes of their times."""

from experiments.runtime.physics import PhysicsCase, SteppedModels, cases, step_cost
from experiments.runtime.physics_batch import BatchCase, batch_speed


def test_cases_are_the_vehicle_its_growth_and_one_body():
    drawn = list(cases(SteppedModels(links=(10, 30))))
    assert [case.table for case in drawn] == ["vehicle"] * 2 + ["growth"] * 4 + ["one body"]
    assert [case.steps for case in drawn[2:4]] == [1200, 400]
    quick = step_cost.space.cases(step_cost.options_with(step_cost.quick))
    assert set(quick) < set(step_cost.space.cases(step_cost.options_with({})))


def test_a_slow_water_is_not_accepted():
    times = {"bare": 1e-5, "exact": 1.5e-5, "ellipsoid fluid": 6e-5, "numpy callback": 2e-4}
    row = {"table": "vehicle", "integrator": "implicitfast", "shape": "serial", "link_count": 6}
    row |= {"steps": 10, "rounds": 1, "step": times | {"numpy callback, drag only": 2e-4}}
    row["ratio"] = {name: duration / 1e-5 for name, duration in row["step"].items()}

    summary = step_cost.summary([row])
    assert summary.failed == []
    cells = dict(zip(summary.tables[0].columns, summary.tables[0].rows[0], strict=True))
    assert cells["bare [µs]"] == "10.00"
    assert cells["exact / ellipsoid"] == "0.25"

    row["step"] |= {"exact": 2e-5}
    assert [line.split(":")[0] for line in step_cost.summary([row]).failed or []] == [
        "exact over bare",
        "exact over ellipsoid fluid",
    ]


def test_times_are_relative_to_the_first_model():
    case = PhysicsCase(table="growth", link_count=2, steps=20, rounds=1)
    row = step_cost(case)
    assert list(row.ratio) == ["bare", "exact"]
    assert row.ratio["bare"] == 1.0
    assert row.ratio["exact"] == row.step["exact"] / row.step["bare"]


def test_a_batch_is_the_same_on_all_threads():
    row = batch_speed(BatchCase(sims=3, steps=5, rounds=1))
    assert row.identical
    assert set(row.step) == set(row.processor) == {"1", "2"}
    assert row.state < row.reserved
