"""An elastic arm: its compliances are worth identifying, and what the loads do not show."""

from experiments.calibration.loads import LoadCase, calibration_loads


def test_compliances_are_identified_where_payloads_differ():
    """Gravity has no changing moment about joints 1 and 6, whose compliances stay hidden."""
    rigid, elastic = (
        calibration_loads(LoadCase(payloads="0 10", model=model, seed=0))
        for model in ("rigid", "elastic")
    )
    assert rigid.identified["10 kg"] > 5.0 * elastic.identified["10 kg"]
    assert rigid.nominal == elastic.nominal
    assert not rigid.relative_sigma

    assert [name for name, hidden in elastic.hidden.items() if hidden] == ["c1", "c6"]
    shown = [sigma for name, sigma in elastic.relative_sigma.items() if not elastic.hidden[name]]
    unseen = [sigma for name, sigma in elastic.relative_sigma.items() if elastic.hidden[name]]
    assert max(shown) < 0.1 < min(unseen)


def test_all_tables_have_their_lines():
    rows = [
        calibration_loads.row(LoadCase(payloads="0", model=model, seed=1))
        for model in ("rigid", "elastic")
    ]
    tables = calibration_loads.summary(rows).tables
    assert [len(table.rows) for table in tables] == [2, 2, 1, 1]
    assert tables[0].columns[2:] == (
        "0 kg: nominal [mm]",
        "0 kg: identified [mm]",
        "5 kg: nominal [mm]",
        "5 kg: identified [mm]",
        "10 kg: nominal [mm]",
        "10 kg: identified [mm]",
    )
    assert tables[2].columns == ("payloads [kg]", "c1", "c2", "c3", "c4", "c5", "c6")
