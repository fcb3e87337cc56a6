"""Pictures of a run by its command: what is refused before anything is drawn."""

import json
from pathlib import Path

import pytest

from run_records import every_run
from uuv.cli.past import picture
from uuv.jobs import clean_object
from uuv.pictures.run_pictures import PictureFiles
from uuv.scenario_file import write_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.reporting.series_tables import PastRun


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run that was made with --no-record."""
    (tmp_path / "metrics.json").write_text(json.dumps(every_run()))
    write_scenario(clean_object(quick=True, sensor="survey"), tmp_path / "scenario.toml")
    return tmp_path


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "no series 'slow'; there are none: it was run with --no-record"),
        (("--size", "1280"), "size: WIDTHxHEIGHT in pixels, like 1280x720, got '1280'"),
        (("--size", "-3x10"), "size: WIDTHxHEIGHT in pixels"),
    ],
)
def test_a_folder_without_series_and_a_wrong_size_are_refused(folder, options, message):
    with pytest.raises(ConfigurationError, match=message):
        picture.main("picture", [str(folder), *options])
    assert sorted(file.name for file in folder.iterdir()) == ["metrics.json", "scenario.toml"]


def test_sizes_are_width_and_height():
    assert picture.size_of("1280x720") == (1280, 720)


@pytest.mark.parametrize("option", ["--at", "--begin", "--end"])
def test_times_beyond_the_run_are_refused_before_it_is_assembled(folder, option, monkeypatch):
    monkeypatch.setattr(PastRun, "units", lambda *_: {})
    with pytest.raises(ConfigurationError, match=rf"{option[2:]} \[s\]: .*<= 12.5, got 30"):
        picture.main("picture", [str(folder), option, "30"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--begin", "5", "--end", "4"), r"begin \[s\] is after end: 5 and 4"),
        (("--clip", "a.webp", "--at", "3"), "at: is the time of a still; --clip alone writes none"),
        (("--still", "a.png", "--frames", "9"), "frames: is of a clip; --still alone writes none"),
        (("--still", "a.png", "--begin", "9"), "begin: is of a clip; --still alone writes none"),
    ],
)
def test_options_that_do_not_fit_are_refused_before_assembly(folder, options, message, monkeypatch):
    monkeypatch.setattr(PastRun, "units", lambda *_: {})
    with pytest.raises(ConfigurationError, match=message):
        picture.main("picture", [str(folder), *options])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"clip": Path("clip.mp4")}, r"clip: must be a file \*.webp, got 'clip.mp4'"),
        ({"still": Path("nowhere/a.png")}, "still: there is no folder 'nowhere'"),
        ({"frames": 1}, "frames: must be a whole number in 2..600, got 1"),
        ({"rate": 0.0}, r"rate of a clip \[1/s\]"),
        ({"rate": 1e-7}, r"rate of a clip \[1/s\]: must be finite, >= 0.1, <= 60, got 1e-07"),
    ],
)
def test_files_that_cannot_be_written_are_refused(options, message):
    with pytest.raises(ConfigurationError, match=message):
        PictureFiles(**options)
