"""Files of plans and walks, opened, changed and sealed again by what docs/formats.md says of
them.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.cli.main import main as command

Array = NDArray[Any]
SAMPLES = ("times_s", "torso_m", "rotation", "feet_m", "forces_n", "contact")


class NoForgery(Exception):
    """What came out can be done, as far as the judge knows: nothing is shown by it."""


@dataclass(kw_only=True)
class Opened:
    """A file's header and its arrays, to be changed in place."""

    head: dict[str, Any]
    arrays: dict[str, Array]

    @property
    def robot(self) -> dict[str, Any]:
        """The robot's part of the header."""
        found: dict[str, Any] = self.head["question"]["robot"]
        return found

    def urdf(self, pattern: str, text: str) -> None:
        """Replace a pattern in the text of the robot's URDF."""
        model = self.robot["model"]
        model["urdf"] = re.sub(pattern, text, model["urdf"], flags=re.DOTALL)
        model["digest"] = _model_digest(model)

    def cut(self, rows: slice) -> None:
        """Keep these samples of a walk."""
        for name in SAMPLES:
            self.arrays[name] = self.arrays[name][rows]

    def sealed(self) -> str:
        """The file's text, every digest of it computed anew."""
        verdict = self.head["verdict"]
        content = hashlib.sha256(_text({k: self.head[k] for k in ("question", "provenance")}))
        for name, array in sorted(self.arrays.items()):
            content.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
            content.update(np.ascontiguousarray(array).tobytes())
        told = {name: verdict[name] for name in ("accepted", "tolerance", "checked", "limits")}
        verdict["digest"] = _canonical({**told, "answer": content.hexdigest()})
        self.head["columns"]["npz"] = _packed(self.arrays)
        self.head["sha256"] = _canonical(
            {key: value for key, value in self.head.items() if key != "sha256"}
        )
        return json.dumps(self.head, allow_nan=True)


def opened(path: Path) -> Opened:
    """A plan or a walk. Every call gives values of its own."""
    head = json.loads(path.read_text())
    with np.load(io.BytesIO(base64.b64decode(head["columns"]["npz"]))) as found:
        return Opened(head=head, arrays={name: found[name] for name in found})


def ran(*words: str | Path) -> tuple[int, str]:
    """Exit code and all that `stancekit` prints."""
    said = io.StringIO()
    code: Any = 0
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            command([str(word) for word in words])
        except SystemExit as end:
            code = end.code or 0
    return int(code), said.getvalue().strip()


def _model_digest(model: dict[str, Any]) -> str:
    legs = (
        f"{leg['name']}\0{leg['foot']}\0{list(leg['stance_rad'].values())}" for leg in model["legs"]
    )
    return hashlib.sha256("\0".join([model["urdf"], *legs]).encode()).hexdigest()


def _packed(arrays: dict[str, Array]) -> str:
    content = io.BytesIO()
    np.savez(content, **arrays)
    return base64.b64encode(content.getvalue()).decode()


def _text(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


def _canonical(value: Any) -> str:
    return hashlib.sha256(_text(value)).hexdigest()
