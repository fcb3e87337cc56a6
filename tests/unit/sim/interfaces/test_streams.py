"""Streams by name: no draw moves another, and a state that was kept goes on to the bit."""

import numpy as np
import pytest
from scipy.stats import kstest, spearmanr

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.streams import Streams, state_of


def drawn(seed: int, names: list[str]) -> dict[str, float]:
    streams = Streams(seed, 5)
    return {name: streams[name].uniform(0.1, 0.4) for name in names}


def test_a_draw_that_is_added_left_out_or_longer_moves_no_other(rng: np.random.Generator):
    seed = int(rng.integers(1000))
    before = drawn(seed, ["speed", "gust", "friction"])
    after = drawn(seed, ["waves", "friction", "speed"])
    assert after["speed"] == before["speed"]
    assert after["friction"] == before["friction"]

    streams = Streams(seed, 5)
    streams["speed"].normal(size=1000)
    assert streams["gust"].uniform(0.1, 0.4) == before["gust"]


def test_a_name_that_is_asked_for_again_goes_on():
    streams = Streams(2)
    together = Streams(2)["noise"].normal(size=4)
    assert [streams["noise"].normal() for _ in range(4)] == together.tolist()


def test_cases_and_names_are_independent():
    """Uniform over 2000 cases, and no correlation between names or with the case before it."""
    u = np.array([[Streams(9, run)[name].random() for name in "ab"] for run in range(2000)])
    for column in u.T:
        assert kstest(column, "uniform").pvalue > 0.01  # measured 0.3 and 0.9
    assert spearmanr(*u.T).pvalue > 0.01  # measured 0.9
    assert spearmanr(u[1:, 0], u[:-1, 0]).pvalue > 0.01  # measured 0.4


def test_streams_go_on_from_the_states_that_were_kept(rng: np.random.Generator):
    """Half a word of 64 bits that a small whole number has left is a part of the state."""
    rng.integers(4)
    states = {"stones": state_of(rng)}
    expected = [int(rng.integers(4)), rng.normal()]
    streams = Streams(states=states.items())
    assert [int(streams["stones"].integers(4)), streams["stones"].normal()] == expected
    with pytest.raises(ConfigurationError, match="no stream 'sand' was kept; there are stones"):
        _ = streams["sand"]


@pytest.mark.parametrize(
    "text", ["", "1 2 3", "1 2 0 z", "1 2 -0 1", f"{1 << 128:x} 1 0 0", "1 1 2 0"]
)
def test_a_text_that_is_no_state_is_refused(text: str):
    with pytest.raises(ConfigurationError, match="state of a stream: must be a text written by"):
        _ = Streams(states=[("stones", text)])["stones"]


def test_a_state_of_another_kind_of_generator_is_refused():
    with pytest.raises(ConfigurationError, match="PCG64 only, got MT19937"):
        state_of(np.random.Generator(np.random.MT19937(1)))
