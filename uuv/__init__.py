"""An underwater vehicle that works with its arm: from a description to a run and its assessment.

    from uuv import jobs, run, show

    r = run(jobs.clean_barrel(seed=0))
    print(r.assessment.failed)
    show(r, "my_run")

Names are imported on first use, so that `uuv.start` can check the version of Python before anything
else.
"""

import os
from pathlib import Path

# Matrices are small, and a second thread of BLAS would only waste a core. Read when numpy is first
# imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_HERE = Path(__file__).resolve().parent
# unpacked without its links to the rooms, which are then in the folder next to it
if not (_HERE / "models").is_dir():
    __path__.append(str(_HERE.parent))

from uuv.sim.interfaces.lazy_names import names_of_stub  # noqa: E402  once the rooms can be found

__getattr__, __dir__, __all__ = names_of_stub(__name__, __file__)
