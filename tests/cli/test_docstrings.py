"""Commands leave SciPy's docstrings as they are and NumPy's modules alone; a user's own process is
not touched.
"""

from __future__ import annotations

import subprocess
import sys

ASKED = """
import sys
from stancekit.cli.pictures import keep_as_written
{}
from scipy import ndimage, special, spatial, stats
from scipy.ndimage import gaussian_filter1d
import numpy as np
assert np.allclose(gaussian_filter1d(np.ones(5), 1.0), 1.0)
print("Array API" in ndimage.gaussian_filter1d.__doc__, "standard deviation" in ndimage.gaussian_filter1d.__doc__)
"""
COPIED = """
import sys
from stancekit.cli.pictures import keep_as_written
keep_as_written()
from scipy import ndimage, spatial, sparse, interpolate, optimize
from scipy._lib.array_api_compat import numpy as xp
import numpy as np
loaded = [name for name in ("numpy.f2py", "numpy.testing", "numpy.matlib") if name in sys.modules]
missing = [name for name in [*vars(np), *np.__all__] if not name.startswith("_") and not hasattr(xp, name)]
computed = xp.linalg.norm(xp.ones(4)), xp.unique_values(xp.ones(3)), callable(np.testing.assert_allclose)
print(loaded, missing, hasattr(xp, "_nothing"), *computed)
"""


def said(line: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", ASKED.format(line)], capture_output=True, text=True, check=True
    ).stdout


def test_a_command_reads_no_docstrings_of_scipy_and_computes_the_same() -> None:
    assert said("keep_as_written()") == "False True\n"


def test_who_imports_the_package_has_scipys_own_help() -> None:
    assert said("import stancekit; stancekit.plan") == "True True\n"


def test_a_command_loads_only_the_modules_of_numpy_that_it_asks_for() -> None:
    """SciPy's copy of NumPy has all that was there; what was not is still there for whoever asks
    NumPy.
    """
    found = subprocess.run(
        [sys.executable, "-c", COPIED], capture_output=True, text=True, check=True
    ).stdout
    assert found == "[] [] False 2.0 [1.] True\n"
