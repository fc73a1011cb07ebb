"""Commands leave SciPy's docstrings as they are written; a user's own process is not touched."""

from __future__ import annotations

import subprocess
import sys

ASKED = """
import sys
from stancekit.cli.docstrings import keep_as_written
{}
from scipy import ndimage, special, spatial, stats
from scipy.ndimage import gaussian_filter1d
import numpy as np
assert np.allclose(gaussian_filter1d(np.ones(5), 1.0), 1.0)
print("Array API" in ndimage.gaussian_filter1d.__doc__, "standard deviation" in ndimage.gaussian_filter1d.__doc__)
"""


def said(line: str) -> str:
    return subprocess.run([sys.executable, "-c", ASKED.format(line)], capture_output=True, text=True, check=True).stdout


def test_a_command_reads_no_docstrings_of_scipy_and_computes_the_same() -> None:
    assert said("keep_as_written()") == "False True\n"


def test_who_imports_the_package_has_scipys_own_help() -> None:
    assert said("import stancekit; stancekit.plan") == "True True\n"
