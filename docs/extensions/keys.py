"""The reference of keys: what every file may say, from the models that read it.

Types, bounds and defaults are those of the models; what a key means is taken from the model's
docstring where that says ``key: meaning``, else from docs/reference/meanings.yaml. ``python
docs/extensions/keys.py`` prints what lacks one.
"""

from __future__ import annotations

import ast
import importlib
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter

from stancekit.planners.files.codec import keys_of

ROOT = Path(__file__).resolve().parents[2]
MEANINGS = ROOT / "docs" / "reference" / "meanings.yaml"
FOLDERS = ("planners", "runner", "views", "envs", "learners")


@dataclass(frozen=True)
class Section:
    """A kind of file: its title, what is said of it, and its keys.

    models: classes as module:class, of pydantic or what it reads. values: classes of which a file
    has the fields, as ``planners.files.codec`` reads and writes them. whole: whether every key of
    them has to be there. ours: whether the program alone writes such files, whose keys have
    meanings and no place on the page.
    """

    title: str
    text: str
    models: tuple[str, ...] = ()
    values: tuple[str, ...] = ()
    whole: bool = True
    ours: bool = False


SECTIONS = (
    Section(
        "Courses",
        "YAML for `stancekit plan FILE`, `stancekit.plan`, `Traverse-v0`; see [terrain](../terrain.md).",
        ("planners.problem.course_keys:CourseSpec",),
    ),
    Section(
        "Leaps",
        "`stancekit/leap/1`, YAML or JSON for `stancekit plan FILE`; see [leaps](../concepts/leaps.md).",
        ("planners.problem.leap_classes:LeapClass",),
        ("planners.problem.leap_classes:_LeapKeys", "planners.problem.leap_classes:_DrawKeys"),
        whole=False,
    ),
    Section(
        "Robots",
        "YAML that names a URDF and corrects it; see [robots](../robots.md).",
        ("planners.robot.robot_file:RobotKeys",),
    ),
    Section(
        "Walkers",
        "YAML of a walking robot's numbers, without a URDF; see [gaits](../concepts/gaits.md).",
        values=("planners.robot.walker:WalkerKeys",),
    ),
    Section(
        "Actuators",
        "`stancekit/actuators/1`, YAML or JSON; see [in simulation](../simulate.md).",
        ("planners.robot.leg:Actuators",),
    ),
    Section(
        "Distributions of postures",
        "YAML for `sample`, `label` and the environments.",
        ("envs.distributions.postures:_Yaml",),
    ),
    Section(
        "Experiments",
        "YAML for `stancekit bench envelopes` and `stancekit fit --config`.",
        (
            "learners.evaluation.evaluate:Experiment",
            "learners.selectors.genetic:GeneticSettings",
            "learners.selectors.neural:NeuralSettings",
        ),
    ),
    Section(
        "Servo buses",
        "`stancekit/servos/1`, YAML for `stancekit run --world dynamixel --setup`.",
        ("runner.worlds.dynamixel.control_table:Calibration",),
    ),
    Section(
        "Robots behind a rosbridge",
        "`stancekit/ros/1`, YAML for `stancekit run --world ros --setup`.",
        ("runner.worlds.ros.joint_states:RosSetup",),
    ),
    Section(
        "Posture problems",
        "`stancekit/posture/1`, JSON; see [formats](../formats.md).",
        values=("planners.problem.posture:PostureKeys",),
    ),
    Section(
        "Courses laid out",
        "`stancekit/course/1`, JSON, as plans and proofs contain it.",
        ("planners.robot.robot_file:ModelJson",),
        ("planners.problem.problem:Problem",),
        ours=True,
    ),
    Section(
        "Envelopes",
        "`stancekit/envelope/1`, JSON.",
        values=("planners.relaxation.envelope:EnvelopeSet",),
    ),
    Section(
        "Data sets",
        "`header.json` of `stancekit/dataset/1` (postures) and of `stancekit/tries/1` (leaps), and "
        "`timing-N.json`.",
        (
            "envs.data.ledger:Header",
            "envs.data.ledger:LabelPlan",
            "envs.data.ledger:TryHeader",
            "envs.data.ledger:TryPlan",
            "envs.data.ledger:ShardTiming",
        ),
        ours=True,
    ),
)

INTERNAL = {
    "planners.files.documents:Strict": "what data classes of files share",
    "learners.evaluation.evaluate:_Row": "rows that a bench keeps between runs",
    "learners.surrogates.surrogate:_Header": "metadata of weights",
    "learners.selectors.neural:_Calibration": "metadata of weights",
    "learners.selectors.neural:_Header": "metadata of weights",
    "learners.selectors.selector:Card": "cards of selectors that ship, which a benchmark writes",
    "learners.selectors.selector:Figure": "cards of selectors that ship, which a benchmark writes",
    "envs.data.ledger:Counts": "written by the program into shards",
    "envs.data.ledger:Head": "what headers of data sets share",
    "envs.data.ledger:Tally": "written by the program into shards",
    "runner.worlds.world:SetupFile": "what servo and rosbridge files share",
    "planners.problem.course_terrain:TerrainSpec": "what all kinds of terrain share",
}
"""Models of files that nobody writes by hand, and parts of others, and why the reference leaves
them out."""


@cache
def forbidding() -> frozenset[str]:
    """Every class of the package that refuses unknown keys, as module:class, found by reading the
    sources.
    """
    classes: dict[str, tuple[str, bool, list[str]]] = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    fields = (
                        line for line in node.body if isinstance(line, ast.Assign | ast.AnnAssign)
                    )
                    says = any(
                        "forbid" in ast.unparse(line) or "STRICT" in ast.unparse(line)
                        for line in fields
                    )
                    bases = [ast.unparse(base).split(".")[-1] for base in node.bases]
                    classes[f"{module}:{node.name}"] = (node.name, says, bases)
    found = {place for place, (_, says, _) in classes.items() if says}
    while True:
        names = {place.split(":")[1] for place in found if not place.endswith(":_Keys")}
        local = {place.split(":")[0] for place in found if place.endswith(":_Keys")}
        more = {
            place
            for place, (_, _, bases) in classes.items()
            if place not in found
            and (names & set(bases) or ("_Keys" in bases and place.split(":")[0] in local))
        }
        if not more:
            return frozenset(place for place in found if not place.endswith(":_Keys"))
        found |= more


def loaded(place: str) -> Any:
    """The class of module:class."""
    module, name = place.split(":")
    return getattr(importlib.import_module(f"stancekit.{module}"), name)


def schemas(section: Section) -> dict[str, dict[str, Any]]:
    """By name, the JSON schema of every model of a section: those that are named, and those that
    they hold.
    """
    found: dict[str, dict[str, Any]] = {}
    kinds = [loaded(place) for place in section.models]
    kinds += [keys_of(loaded(place), whole=section.whole) for place in section.values]
    for kind in kinds:
        schema = TypeAdapter(kind).json_schema()
        held = schema.pop("$defs", {})
        found[kind.__name__] = schema
        order = list(re.findall(r"#/\$defs/(\w+)", json.dumps(schema)))
        for name in order:
            if name not in found:
                found[name] = held[name]
                order += re.findall(r"#/\$defs/(\w+)", json.dumps(held[name]))
    return found


def kind_of(schema: dict[str, Any]) -> str:
    """A key's type and bounds, in words."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name.strip('_')}](#{anchor(name)})"
    for several in ("anyOf", "oneOf"):
        if several in schema:
            kinds = dict.fromkeys(kind_of(one) for one in schema[several])
            return " or ".join(kind for kind in kinds if kind != "null")
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    kind = schema.get("type")
    if kind in ("number", "integer"):
        return kind + _bounds(schema)
    if kind == "array":
        return _array(schema)
    if kind == "object":
        held = schema.get("additionalProperties")
        return f"mapping of names to {kind_of(held)}" if isinstance(held, dict) else "mapping"
    return {"string": "text", "boolean": "true or false", "null": "null", None: "anything"}[kind]


LARGEST = 1e6
"""Bounds of so much are there so that arithmetic is safe, and are not worth a reader's time."""


def _bounds(schema: dict[str, Any]) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    parts = []
    if low is not None and low > -LARGEST:
        parts.append(f"≥ {low:g}")
    if above is not None:
        parts.append(f"> {above:g}")
    if high is not None and high < LARGEST:
        parts.append(f"≤ {high:g}")
    if below is not None and below < LARGEST:
        parts.append(f"< {below:g}")
    return "".join(f" {part}" if index == 0 else f", {part}" for index, part in enumerate(parts))


def _array(schema: dict[str, Any]) -> str:
    if "prefixItems" in schema:
        items = [kind_of(one) for one in schema["prefixItems"]]
        same = len(set(items)) == 1 and len(items) > 1
        return f"{len(items)} × {items[0]}" if same else f"[{', '.join(items)}]"
    least, most = schema.get("minItems"), schema.get("maxItems")
    count = {(None, None): "", (1, None): " (one or more)"}.get(
        (least, most), f" ({least or 0} to {most or 'any'})"
    )
    return f"list{count} of {kind_of(schema['items'])}" if "items" in schema else f"list{count}"


def anchor(name: str) -> str:
    """Of a model's table."""
    return f"keys-{name.strip('_').lower()}"


def own_meanings(docstring: str, keys: set[str]) -> dict[str, str]:
    """Meanings of keys in a docstring's ``Arguments:``, ``key: text`` or ``key, key: text`` each."""
    section = re.search(r"^Arguments:\n((?: .*\n?|\n(?= ))*)", docstring, re.M)
    entries = re.split(r"^    (?=\S)", section[1] if section else "", flags=re.M)
    texts: dict[str, str] = {}
    for entry in entries:
        names, _, text = " ".join(entry.split()).partition(": ")
        if text and set(names.split(", ")) <= keys:
            texts |= dict.fromkeys(names.split(", "), text.rstrip("."))
    return texts


def meanings(
    name: str, schema: dict[str, Any], written: dict[str, dict[str, str]]
) -> dict[str, str]:
    """By key: what it means; keys without a meaning are left out."""
    keys = set(schema.get("properties", {}))
    usual = {key: text for key, text in written.get("any", {}).items() if key in keys}
    return usual | own_meanings(schema.get("description", ""), keys) | written.get(name, {})


def written_meanings() -> dict[str, dict[str, str]]:
    """What docs/reference/meanings.yaml says."""
    return yaml.safe_load(MEANINGS.read_text(encoding="utf-8")) or {}


def page() -> str:
    """The whole reference, Markdown."""
    written = written_meanings()
    lines = [
        "# Keys of files",
        "",
        "Every key that a file may have, from the models that read it. A reader refuses unknown and missing keys, and",
        "names every one that is wrong. Bold keys have to be there; the others may be left out, or null where they have",
        "no default. Numbers are SI, in the units that names end in.",
        "",
    ]
    seen: set[str] = set()
    for section in (each for each in SECTIONS if not each.ours):
        lines += [f"## {section.title}", "", section.text, ""]
        for name, schema in schemas(section).items():
            if name not in seen:
                seen.add(name)
                lines += _table(name, schema, written)
    return "\n".join(lines)


def _table(name: str, schema: dict[str, Any], written: dict[str, dict[str, str]]) -> list[str]:
    keys, required = schema.get("properties", {}), set(schema.get("required", ()))
    says = meanings(name, schema, written)
    brief = (schema.get("description") or "").split("\n\n")[0].replace("\n", " ")
    brief = re.split(r"(?<!\bal)(?<!\bFig)\. ", brief)[0].rstrip(".").split(" limbs:")[0]
    brief = re.sub(r"``([^`]*)``", r"`\1`", brief)
    lines = [f"({anchor(name)})=", f"### {name.strip('_')}", "", f"{brief}.", ""]
    rows: dict[tuple[str, str, str], list[str]] = {}
    for key, value in keys.items():
        default = "" if key in required else _default(value)
        shown = f"**`{key}`**" if key in required else f"`{key}`"
        text = re.sub(r"``([^`]*)``", r"`\1`", says.get(key, "")).replace("|", "\\|")
        text = re.sub(r"\bNone\b", "null", text)
        kind = kind_of(value)
        rows.setdefault((kind, default, text), []).append(shown)
    some = any(default for _, default, _ in rows)
    lines += ["| key | type | default | meaning |" if some else "| key | type | meaning |"]
    lines += ["|---|---|---|---|" if some else "|---|---|---|"]
    for (kind, default, text), names in rows.items():
        cells = [", ".join(names), kind, *([default] if some else []), text]
        lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def _default(schema: dict[str, Any]) -> str:
    """A default that is a number, a text or a list of some."""
    value = schema.get("default")
    if value in (None, "", []) or isinstance(value, dict):
        return ""
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def missing() -> Iterator[str]:
    """Keys without a meaning, meanings without a key, and models that neither the reference nor
    INTERNAL knows.
    """
    written, reached, known = written_meanings(), set(), set()
    for section in SECTIONS:
        for name, schema in schemas(section).items():
            keys = set(schema.get("properties", {}))
            reached.add(name)
            known |= {f"{name}.{key}" for key in keys}
            yield from (
                f"{name}.{key}: no meaning"
                for key in sorted(keys - set(meanings(name, schema, written)))
            )
    everywhere = {place.split(".")[1] for place in known}
    yield from (
        f"any.{key}: a meaning of no key" for key in written["any"] if key not in everywhere
    )
    for name, texts in written.items():
        if name == "any":
            continue
        yield from (
            f"{name}.{key}: a meaning of no key" for key in texts if f"{name}.{key}" not in known
        )
    for place in sorted(forbidding() - set(INTERNAL)):
        if place.split(":")[1] not in reached:
            yield f"{place}: not in the reference, and not in INTERNAL"
    yield from (
        f"{place}: in INTERNAL, and not there" for place in sorted(set(INTERNAL) - forbidding())
    )


if __name__ == "__main__":
    found = list(missing())
    sys.stdout.write("".join(f"{line}\n" for line in found))
    sys.exit(bool(found))
