"""The one place that imports Open3D: late, libusb preloaded, with a clear error where it or a library of it is missing.

Nothing of a job needs it but the rays on Linux on ARM. It is what our own methods are compared with.
"""

import ctypes
import warnings
from functools import cache
from typing import Any

from sim.interfaces.errors import MissingLibraryError

DEBIAN_PACKAGES = "libgl1 libegl1 libx11-6 libudev1 libidn2-0"


@cache
def load() -> Any:
    """The `open3d` module, imported on the first call (about 1-2 s).

    Raises MissingLibraryError, with what to install, if Open3D or a system library that it needs is missing.
    """
    try:
        import libusb_package  # pyright: ignore[reportMissingImports]

        # Open3D's extension wants libusb-1.0.so.0 although no camera is used; bare machines do not have it.
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import open3d  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"the package {error.name} is not installed; Open3D, and what it needs, come with: "
            "./uvw run --extra open3d ..., or pip install '.[open3d]' in the checkout"
        ) from error
    except (ImportError, OSError) as error:
        raise MissingLibraryError(
            f"Open3D cannot be imported ({error}). On Debian or Ubuntu: apt install {DEBIAN_PACKAGES}"
        ) from error
    # Its warnings go to stdout; everything that matters comes back to our callers as an error.
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d
