"""Play one file and print a line of JSON; in benchmarks/: ``python -m referee FILE [--feedback]
[--delay-ms 15]``.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import fields

from . import BrokenFile, Push, Wrong, play, read_settings


def main() -> None:
    """Play it; exit code 0 where it stood, 1 where it fell, 2 for a file that cannot be played."""
    parser = argparse.ArgumentParser(prog="referee", description=__doc__)
    parser.add_argument("file")
    for option in fields(Wrong):
        name = f"--{option.name.replace('_', '-')}"
        if isinstance(option.default, bool):
            parser.add_argument(name, action="store_true")
        else:
            kind = int if isinstance(option.default, int) else float
            parser.add_argument(name, type=kind, default=option.default)
    parser.add_argument("--push-n", type=float, help="push a stance until it falls, or up to this")
    parser.add_argument("--push-deg", type=float, default=0.0)
    parser.add_argument("--push-stance", type=float, default=0.0)
    asked = parser.parse_args()
    wrong = Wrong(**{option.name: getattr(asked, option.name) for option in fields(Wrong)})
    push = None
    if asked.push_n is not None:
        push = Push(most_n=asked.push_n, towards_deg=asked.push_deg, stance=asked.push_stance)
    try:
        row = play(asked.file, read_settings(), wrong, push)
    except BrokenFile as error:
        print(f"referee: {error}", file=sys.stderr)
        sys.exit(2)
    print(json.dumps({"file": asked.file, **row.json(), "wrong": wrong.said()}))
    sys.exit(0 if row.stood else 1)


if __name__ == "__main__":
    main()
