"""A robot that stands still while something is worked out."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ..run import Runner

Answer = TypeVar("Answer")


def held_while(runner: Runner, work: Callable[[], Answer]) -> Answer:
    """The answer of some work, while something real is sent again and again where it is."""
    world = runner.world
    if not world.real or world.dry:
        return work()
    pool = ThreadPoolExecutor(1)
    try:
        future = pool.submit(work)
        while not future.done():
            runner.send(world.last_rad, world.last_rad)
        return future.result()
    finally:
        pool.shutdown(
            wait=False, cancel_futures=True
        )  # the ending of a run that is stopped waits for no planner
