"""Old forms of calls, which are accepted for one release, each with a warning that shows the new
form.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any


def old_arguments(
    function: str, old: Mapping[str, Any], new: Mapping[str, str], beside: tuple[str, ...]
) -> dict[str, Any]:
    """The old arguments of a call, after a ``DeprecationWarning`` about each.

    Arguments:
        function: the function's name.
        old: arguments of the call that are not parameters of the function.
        new: form that replaces each old argument.
        beside: its parameters, for the message.

    Raises:
        TypeError: for an argument that never was one, as a call of any function does.
    """
    for name in old:
        if name not in new:
            raise TypeError(
                f"stancekit.{function}: got an unexpected keyword argument {name!r}; it takes "
                f"{', '.join(beside)}"
            )
        warnings.warn(
            f"{function}({name}=...) is old: {new[name]}", DeprecationWarning, stacklevel=4
        )
    return dict(old)


def old_form(said: str, new: str) -> None:
    """Warn that a call is in an old form.

    Arguments:
        said, new: both forms; the warning is the caller's caller's.
    """
    warnings.warn(f"{said} is old: {new}", DeprecationWarning, stacklevel=4)
