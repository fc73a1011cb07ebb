"""``stancekit export``: expert data for other programs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from .console import emit, out, progress


@dataclass
class Export:
    """Write a labelled data set as a Minari data set: one-step episodes of EnvelopeSelection-v0, acted by the expert.

    The action is the smallest box around the exact planner's positions and forces, moved out by a little room. The data
    set is read back before it counts as written. To use it: MINARI_DATASETS_PATH=OUT and minari.load_dataset(ID).
    """

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Data set folder of `stancekit label`."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="OUT")]
    """New folder, or an empty one; nothing is written anywhere else."""
    room: float = 0.02
    """How far every side of the expert's box is moved out (non-dimensional)."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Export, and read back."""
        from stancekit.learners.data.export import load_exported
        from stancekit.selectors import export

        with progress("export") as bar:
            done = export(self.dataset, self.out, room=self.room, progress=bar)
        there = load_exported(self.out).total_episodes
        record = {**asdict(done), "root": str(done.root), "read_back": int(there)}
        if self.json:
            emit(record)
        else:
            out.print(
                f"{done.root}: {there} episodes of {done.dataset_id}, mean reward {done.mean_reward:.3f}, "
                f"P1 over the expert's box agrees with the label in {100.0 * done.agreement:.1f} %"
            )
        return 0 if there == done.episodes else 1
