"""Experiments: many cases in worker processes, resumed after an interruption and summarised on a
page.

Names are imported on first use, since rows need pyarrow, which a single run does not.
"""

from uuv.sim.interfaces.lazy_names import names_of_stub

__getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)
