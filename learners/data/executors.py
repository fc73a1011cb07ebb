"""The executors by the names that commands have for them: processes of this computer, or a Ray
cluster.
"""

from __future__ import annotations

from stancekit.planners.errors import InvalidInput

from .executor import Executor, Kind, processes
from .ray_cluster import ray_cluster


def executor(kind: Kind = "processes", *, workers: int = 1, address: str | None = None) -> Executor:
    """The executor with a name.

    Arguments:
        kind: "processes" or "ray".
        workers: number of processes; of no use to a cluster.
        address: of the cluster, "auto" where it is None.

    Raises:
        InvalidInput: for another name, and for an address that processes have no use for.
    """
    if kind == "processes":
        if address is not None:
            raise InvalidInput(
                f"address: expected none for processes, got {address!r}; use it with the executor "
                "ray"
            )
        return processes(workers)
    if kind == "ray":
        return ray_cluster(address or "auto")
    raise InvalidInput(f"executor: expected processes or ray, got {kind!r}")
