"""Videos: frames of pixels written as MP4 by ffmpeg, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from subprocess import PIPE, Popen
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.writing import check_writable, failure_of, replaced

Frame = NDArray[np.uint8]


def check_video(path: str | Path) -> Path:
    """The file behind the name of a video, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .mp4, where nothing can be written, and
    without ffmpeg.
    """
    if Path(path).suffix.lower() != ".mp4":
        raise InvalidInput(
            f"{path}: expected a name that ends in .mp4, got {Path(path).suffix or 'no suffix'}"
        )
    _ffmpeg()
    return check_writable(path)


def write_video(path: str | Path, frames: Iterable[Frame], fps: float = 25.0) -> int:
    """Write frames, uint8 of shape (H, W, 3) and all of one size, as H.264 in MP4; returns how many
    there were.

    Frames are taken one by one, so a generator needs little memory; an odd last row or column is
    left out, as the format has none. Raises InvalidInput for frames that are none, for no frames,
    and as ``check_video``.
    """
    check_video(path)
    if not 0.0 < fps <= 1000.0:
        raise InvalidInput(f"fps: expected a number above 0, up to 1000, got {fps:g}")
    checked = _checked(frames)
    first = next(checked, None)
    if first is None:
        raise InvalidInput(f"{path}: expected one or more frames, got none")
    count = 1
    with replaced(path) as temporary, _encoder(temporary, first, fps) as partial_file:
        partial_file(first)
        for frame in checked:
            partial_file(frame)
            count += 1
    return count


def _checked(frames: Iterable[Frame]) -> Iterator[Frame]:
    """The frames with an even number of rows and columns.

    Raises InvalidInput for one that does not fit the first.
    """
    shape: tuple[int, ...] | None = None
    for index, frame in enumerate(frames):
        pixels = np.asarray(frame)
        if (
            pixels.dtype != np.uint8
            or pixels.ndim != 3
            or pixels.shape[2] != 3
            or min(pixels.shape) < 2
        ):
            raise InvalidInput(
                f"frames[{index}]: expected uint8 of shape (H, W, 3), got {pixels.dtype} "
                f"{pixels.shape}"
            )
        if shape is not None and pixels.shape != shape:
            raise InvalidInput(
                f"frames[{index}]: expected shape {shape} as the first, got {pixels.shape}"
            )
        shape = pixels.shape
        yield pixels[: shape[0] // 2 * 2, : shape[1] // 2 * 2]


@contextmanager
def _encoder(path: Path, first: Frame, fps: float) -> Iterator[Callable[[Frame], object]]:
    """A function that ffmpeg gets frames by.

    Raises OSError where not all of them are in the file at the end.

    imageio_ffmpeg, which brings ffmpeg, keeps its exit status to itself, and so a disk that is full
    at the last block.
    """
    rows, columns = first.shape[:2]
    options = [
        "-y",
        "-v",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{columns}x{rows}",
        "-r",
        f"{fps:g}",
    ]
    options += [
        "-i",
        "-",
        "-an",
        "-vcodec",
        "libx264",
        "-preset",
        "veryfast",
        "-pix_fmt",
        "yuv420p",
        "-crf",
        "16",
        "-f",
        "mp4",
    ]
    failed = True
    with TemporaryFile() as sink, path.open("r+b") as film:
        # by its descriptor: an ffmpeg that outlives this process makes no file of that name again
        arguments, descriptors = [_ffmpeg(), *options, f"/dev/fd/{film.fileno()}"], (film.fileno(),)
        with Popen(
            arguments, stdin=PIPE, stderr=sink, pass_fds=descriptors, start_new_session=True
        ) as process:
            assert process.stdin is not None
            stream = process.stdin
            try:
                yield lambda frame: stream.write(np.ascontiguousarray(frame).data)
                stream.close()
                failed = process.wait() != 0
            except BrokenPipeError:  # it ended early, and says why
                pass
            except BaseException:  # no encoder is left behind; it is raised again
                process.kill()
                raise
            finally:
                with suppress(OSError):
                    stream.close()
        if failed:
            sink.seek(0)
            raise failure_of("ffmpeg", sink.read().decode(errors="replace"))


def _ffmpeg() -> str:
    """The path of ffmpeg."""
    try:
        return str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise not_installed("video", "ffmpeg", "films", "viz") from None
