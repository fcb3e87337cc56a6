"""The map of waves: what is counted as kept, and a sound thruster that is blamed fails it."""

from typing import Any

from experiments.contact.wave_map import BLAMED, line, summarise
from uuv.campaigns.contact_study import DAMAGED


def row(amplitude: float, **changed: Any) -> dict[str, Any]:
    kept = {
        "amplitude": amplitude,
        "frequency": 0.15,
        "direction": "across",
        "path": "transverse",
        "seed": 3,
        "class": "kept",
        "kind": "",
        "detail": "",
        "force_peak_n": 4.0,
        "force_over_set": 1.05,
        "excursion_m": 0.03,
    }
    return {**kept, **changed}


def test_runs_are_counted_by_wave():
    refused = {
        "class": "refused",
        "kind": "hull not at rest",
        "force_peak_n": None,
        "excursion_m": None,
    }
    told = summarise(
        [row(0.1), row(0.1, force_peak_n=6.0), row(0.1, **refused), row(0.2, **refused)]
    )
    assert not told.failed
    assert told.metrics == {"runs": 4, "kept": 2, "blamed": 0, "force_over_set": 1.05}
    tables = told.tables or []
    assert tables[0].rows == [("across", "0.15", "2/3  5.0, 30", "0/1")]
    assert tables[1].rows == [("kept", "–", "2"), ("refused", "hull not at rest", "2")]


def test_a_sound_thruster_that_is_blamed_fails_the_map():
    blamed = row(0.1, **{"class": "broken off", "kind": BLAMED, "detail": "thruster sway is lost"})
    told = summarise([row(0.1), blamed])
    failed = told.failed or []
    assert len(failed) == 1
    assert "thruster sway is lost" in failed[0]
    assert line(blamed) == failed[0]
    assert line(row(0.1)) == ""


def test_damage_is_told():
    damaged = row(
        0.1,
        **{"class": DAMAGED, "kind": "force above 1.5 times the set one", "detail": "felt 140 N"},
    )
    assert "force above 1.5 times the set one: felt 140 N" in line(damaged)


def test_the_figures_of_a_wave_are_medians():
    told = summarise([row(0.1, force_peak_n=force) for force in (3.0, 4.0, 20.0)])
    assert (told.tables or [])[0].rows == [("across", "0.15", "3/3  4.0, 30")]
