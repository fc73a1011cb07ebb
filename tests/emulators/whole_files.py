"""Is a file that was written whole? Read back by whoever reads its kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

VERIFIED = ("stancekit/motion/", "stancekit/certificate/")


def broken(path: Path, run: Callable[..., int]) -> str:
    """Why a file is not whole, "" where it is. run: the command, to verify what it can."""
    if path.is_dir():
        return ""
    try:
        return READERS[path.suffix](path, run)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _json(path: Path, run: Callable[..., int]) -> str:
    data = json.loads(path.read_text())
    if isinstance(data, dict) and str(data.get("format", "")).startswith(VERIFIED):
        code = run("verify", path.name)
        return "" if code == 0 else f"verify: exit code {code}"
    return ""


def _lines(path: Path, run: Callable[..., int]) -> str:
    text = path.read_text()
    return (
        ""
        if all(json.loads(line) for line in text.splitlines()) and text.endswith("\n")
        else "cut off"
    )


def _picture(path: Path, run: Callable[..., int]) -> str:
    from PIL import Image

    with Image.open(path) as picture:
        picture.load()
    return ""


def _text(path: Path, run: Callable[..., int]) -> str:
    return "" if path.read_text().rstrip().endswith(("</html>", "</svg>")) else "cut off"


def _film(path: Path, run: Callable[..., int]) -> str:
    import imageio_ffmpeg

    return "" if imageio_ffmpeg.count_frames_and_secs(str(path))[0] > 1 else "no frames"


def _archive(path: Path, run: Callable[..., int]) -> str:
    import numpy as np

    with np.load(path, allow_pickle=False) as arrays:
        return "" if all(arrays[name] is not None for name in arrays.files) else "no arrays"


def _table(path: Path, run: Callable[..., int]) -> str:
    import pyarrow.parquet as pq

    return "" if pq.read_table(path, page_checksum_verification=True).num_rows else "no rows"


def _tensors(path: Path, run: Callable[..., int]) -> str:
    from safetensors import safe_open

    with safe_open(path, framework="np") as file:
        return "" if [file.get_tensor(name) for name in file.keys()] else "no tensors"  # noqa: SIM118


def _log(path: Path, run: Callable[..., int]) -> str:
    from stancekit.runner.log import read_log

    return "" if read_log(path).whole else "cut off"


def _hdf(path: Path, run: Callable[..., int]) -> str:
    import h5py

    with h5py.File(path) as file:
        return "" if len(file) else "empty"


READERS: dict[str, Callable[[Path, Callable[..., int]], str]] = {
    ".json": _json,
    ".jsonl": _lines,
    ".png": _picture,
    ".svg": _text,
    ".html": _text,
    ".mp4": _film,
    ".npz": _archive,
    ".parquet": _table,
    ".safetensors": _tensors,
    ".mcap": _log,
    ".hdf5": _hdf,
}
