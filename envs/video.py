"""Videos: frames of pixels written as MP4 by ffmpeg, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.files import check_writable
from stancekit.planners.outcome import InvalidInput

Frame = NDArray[np.uint8]


def check_video(path: str | Path) -> Path:
    """The file behind the name of a video, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .mp4, where nothing can be written, and without ffmpeg.
    """
    if Path(path).suffix.lower() != ".mp4":
        raise InvalidInput(f"{path}: expected a name that ends in .mp4, got {Path(path).suffix or 'no suffix'}")
    _ffmpeg()
    return check_writable(path)


def write_video(path: str | Path, frames: Iterable[Frame], fps: float = 25.0) -> int:
    """Write frames, uint8 of shape (H, W, 3) and all of one size, as H.264 in MP4; returns how many there were.

    Frames are taken one by one, so a generator needs little memory; an odd last row or column is left out, as the
    format has none. Raises InvalidInput for frames that are none, for no frames, and as ``check_video``.
    """
    target = check_video(path)
    if not 0.0 < fps <= 1000.0:
        raise InvalidInput(f"fps: expected a number above 0, up to 1000, got {fps:g}")
    checked = _checked(frames)
    first = next(checked, None)
    if first is None:
        raise InvalidInput(f"{path}: expected one or more frames, got none")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp.mp4")
    count = 1
    try:
        with closing(_writer(temporary, first, fps)) as writer:
            writer.send(None)
            writer.send(np.ascontiguousarray(first))
            for frame in checked:
                writer.send(np.ascontiguousarray(frame))
                count += 1
        os.replace(temporary, target)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be written: {error.strerror or str(error).splitlines()[0]}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
    return count


def _checked(frames: Iterable[Frame]) -> Iterator[Frame]:
    """The frames with an even number of rows and columns. Raises InvalidInput for one that does not fit the first."""
    shape: tuple[int, ...] | None = None
    for index, frame in enumerate(frames):
        pixels = np.asarray(frame)
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or min(pixels.shape) < 2:
            raise InvalidInput(f"frames[{index}]: expected uint8 of shape (H, W, 3), got {pixels.dtype} {pixels.shape}")
        if shape is not None and pixels.shape != shape:
            raise InvalidInput(f"frames[{index}]: expected shape {shape} as the first, got {pixels.shape}")
        shape = pixels.shape
        yield pixels[: shape[0] // 2 * 2, : shape[1] // 2 * 2]


def _writer(path: Path, first: Frame, fps: float) -> Any:
    size = (first.shape[1], first.shape[0])
    return _ffmpeg().write_frames(
        str(path), size, fps=fps, codec="libx264", quality=8, macro_block_size=2, ffmpeg_log_level="error"
    )


def _ffmpeg() -> Any:
    """The module that runs ffmpeg."""
    try:
        module = import_module("imageio_ffmpeg")
        module.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        raise InvalidInput("video: expected ffmpeg; install it with pip install 'stancekit[viz]'") from None
    return module
