"""Set-up files of what is real, YAML or JSON: which robot's joints there are, and what a device
calls each of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import yaml
from pydantic import ConfigDict, Field

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import read_yaml, shown, validated
from stancekit.planners.files.writing import write_text


@dataclass(frozen=True, kw_only=True)
class SetupFile:
    """The joints of a device, by name.

    Subclasses have ``joints``, and ``format`` by which their files begin.

    Arguments:
        robot: the name of the robot that the device moves; a plan for another one is refused. None
            says nothing.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    format: str
    robot: Annotated[str | None, Field(min_length=1)] = None
    joints: Mapping[str, Any]

    def check(self, joints: Sequence[str]) -> None:
        """Raise InvalidInput unless it has exactly these joints."""
        missing = [name for name in joints if name not in self.joints]
        unknown = [name for name in self.joints if name not in joints]
        wrong = [f"expected joint {', '.join(missing)}, got nothing"] if missing else []
        wrong += [f"unknown joint {', '.join(unknown)}"] if unknown else []
        if wrong:
            raise InvalidInput("joints: " + "; ".join(wrong))

    @classmethod
    def from_yaml(cls, path: str | Path, joints: Sequence[str] | None = None) -> Self:
        """Read a file, YAML or JSON, for a robot with these joints.

        Raises InvalidInput with all that is wrong.
        """
        data, known = read_yaml(path), cls.__dataclass_fields__["format"].default
        if data.get("format") != known:
            raise InvalidInput(
                f"{path}: format: expected {known}, got {shown(data.get('format'), 40)}"
            )
        setup = validated(cls, data, str(path))
        if joints is not None:
            try:
                setup.check(joints)
            except InvalidInput as error:
                raise InvalidInput(f"{path}: {error}") from None
        return setup

    def write(self, path: str | Path) -> None:
        """Write a file that ``from_yaml`` reads."""
        write_text(path, yaml.safe_dump(asdict(self), sort_keys=False))


def own(names: Mapping[str, Any], key: str, what: str) -> list[str]:
    """One line for every joint whose name or number at the device another joint before it has."""
    owner, wrong = dict[Any, str](), list[str]()
    for joint, name in names.items():
        if name in owner:
            wrong.append(
                f"joints.{joint}.{key}: expected {what}, got {name}, which {owner[name]} has"
            )
        owner.setdefault(name, joint)
    return wrong
